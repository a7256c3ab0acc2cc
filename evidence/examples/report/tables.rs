//! Section 1: the paper's Tables 1 to 3, its figures beside ours, and its claim about time weights.

use crate::cast::{Member, bounce_rays, camera_rays, exact, flake, laid_out_wide, scene};
use crate::measure::{Figures, faster, fastest, measure};
use crate::page::{Item, Section, Table};
use crate::run::Run;
use crate::time_weights;
use crate::wide_table::{self, WideScene};
use mbkd_evidence::timing::{Times, on_one_thread};
use mbkd_scenes::Random;
use std::error::Error;

/// A scene of the paper and ours in its place, with what the paper reports of it.
struct Pair {
    ours: &'static str,
    paper: &'static str,
    /// Build and render time in per cent of BVH_i's (Table 1): MSBVH, MBKD.
    build: [Option<u32>; 2],
    render: [Option<u32>; 2],
    /// Duplicates, time of duplication and of propagation in per cent (Table 2).
    shares: Option<[f64; 3]>,
    /// Megabytes of BVH_i, MSBVH, MBKD (Table 3).
    memory: [u32; 3],
}

const PAIRS: [Pair; 5] = [
    Pair {
        ours: "camera",
        paper: "Sponza",
        build: [Some(152), Some(158)],
        render: [Some(73), Some(62)],
        shares: Some([5.3, 21.7, 1.5]),
        memory: [93, 101, 122],
    },
    Pair {
        ours: "hall",
        paper: "Ben",
        build: [Some(120), Some(128)],
        render: [Some(75), Some(65)],
        shares: Some([5.9, 19.9, 2.9]),
        memory: [170, 179, 219],
    },
    Pair {
        ours: "hairball",
        paper: "Hairball",
        build: [Some(119), Some(124)],
        render: [Some(86), Some(65)],
        shares: Some([10.5, 17.9, 5.9]),
        memory: [470, 503, 578],
    },
    Pair {
        ours: "flake",
        paper: "Flake",
        build: [None, None],
        render: [None, None],
        shares: None,
        memory: [65, 72, 87],
    },
    Pair {
        ours: "hand",
        paper: "Hand",
        build: [Some(150), Some(164)],
        render: [Some(74), Some(55)],
        shares: Some([13.9, 23.4, 15.5]),
        memory: [42, 47, 55],
    },
];

/// The place of the paper's tree and of others in the cast.
const MSBVH: usize = 1;
const CLASSIC: usize = 2;
const PAPER: usize = 4;
const MOVING_PLANES: usize = 5;
const WIDE: usize = 6;

/// Makes the section.
pub fn run(run: &Run) -> Result<Section, Box<dyn Error>> {
    run.begin("tables", 2 * PAIRS.len());
    let mut cast = exact();
    let binary = cast.len();
    cast.extend(laid_out_wide());
    let (mut measured, mut wide) = (Vec::new(), Vec::new());
    let mut weights = Vec::new();
    for pair in &PAIRS {
        run.step(pair.ours);
        let size = run.pick(4_000, 20_000);
        let mut random = Random(run.seed);
        let (meshes, camera) = if pair.ours == "flake" {
            (flake(size), Vec::new())
        } else {
            let scene = scene(pair.ours, size)?;
            let rays = camera_rays(&scene, run.pick(48, 128), &mut random);
            (scene.meshes, rays)
        };
        let bounce = bounce_rays(&meshes, &camera, &mut random)?;
        let rounds = run.pick([1, 3], [1, 7]);
        // The flake is built and weighed only.
        let members = if camera.is_empty() { &cast[..binary] } else { &cast[..] };
        let mut figures = on_one_thread(|| measure(members, &meshes, [&camera, &bounce], rounds))?;
        if !camera.is_empty() {
            wide.push(figures.split_off(binary));
        }
        measured.push(figures);
        run.step("time weights");
        if pair.ours != "flake" && pair.ours != "camera" {
            let scene = scene(pair.ours, run.pick(3_000, 10_000))?;
            let rays = camera_rays(&scene, 48, &mut random);
            weights.push(time_weights::compare(pair.ours, &scene.meshes, &rays)?);
        }
    }
    let laid_out_wide = cast.split_off(binary);
    let mut items = vec![Item::Text(
        "The paper's figures are percentages of BVH_i for its own scenes on a processor of 2013. Ours are measured on \
         procedural scenes of the same kind: camera (a static hall, the camera moves) for Sponza, hall (a figure runs \
         through it) for Ben, hairball and hand for their namesakes, and balls of twenty triangles for the flake. All \
         structures use the same triangle test, are built and traversed on one thread, and return the same answers to \
         the last bit. BVH_i and MSBVH choose their splits at mid-shutter with the costs of the k-d trees (step 1, \
         test 2); an MSBVH may make two references per triangle, a k-d tree eight."
            .into(),
    )];
    items.push(Item::Table(table_1(&cast, &measured)));
    items.extend(claims(&measured));
    let rendered = PAIRS.iter().zip(&measured).filter(|(pair, _)| pair.ours != "flake");
    let scenes: Vec<WideScene> =
        rendered.zip(&wide).map(|((pair, binary), wide)| WideScene { name: pair.ours, binary, wide }).collect();
    items.extend(wide_table::items(&cast, &laid_out_wide, &scenes));
    items.push(Item::Table(table_2(&cast, &measured)));
    items.push(Item::Text(
        "The paper does not say what its number of duplicates is a share of. Ours is a share of all references in \
         leaves, so 50 % means two references per triangle. We count every reference beyond the first of a triangle, \
         including those of triangles that straddle a plane without crossing it, which every k-d tree has; and our \
         trees end only where cost or budget say so. Hence the large numbers. The column of timed references counts \
         those that hold for part of the shutter only, which are the ones caused by motion. Times are those of \
         duplication (Normal references) and propagation (BP references); the rest of a build chooses planes, in one \
         pass over bins where the paper sorts, so its share is smaller here."
            .into(),
    ));
    items.push(Item::Table(table_3(&cast, &measured)));
    items.push(Item::Text(
        "Memory counts nodes, references and triangles. The paper's figures include the scene of its renderer, which \
         draws all ratios towards 100."
            .into(),
    ));
    items.extend(time_weights::items(&weights));
    Ok(Section { id: "tables", title: "1. The paper's tables", items })
}

/// The paper's figure of a structure of the cast.
fn paper_figure(figures: [Option<u32>; 2], member: usize) -> Option<u32> {
    match member {
        0 => figures[0].map(|_| 100),
        MSBVH => figures[0],
        PAPER => figures[1],
        _ => None,
    }
}

fn or_dash(figure: Option<u32>) -> String {
    figure.map_or("–".into(), |figure| figure.to_string())
}

fn columns(names: &[&str]) -> Vec<String> {
    names.iter().map(|name| name.to_string()).collect()
}

fn table_1(cast: &[Member], measured: &[Vec<Figures>]) -> Table {
    let mut rows = Vec::new();
    for (pair, scene) in PAIRS.iter().zip(measured).filter(|(pair, _)| pair.ours != "flake") {
        for (i, (member, of)) in cast.iter().zip(scene).enumerate() {
            let relative = |time: Times, to: Times| format!("{:.0}", 100.0 * time.median / to.median);
            rows.push(vec![
                format!("{} ({})", pair.ours, pair.paper),
                member.name.to_string(),
                relative(of.build, scene[0].build),
                or_dash(paper_figure(pair.build, i)),
                relative(of.rays[0], scene[0].rays[0]),
                relative(of.rays[1], scene[0].rays[1]),
                or_dash(paper_figure(pair.render, i)),
                format!("{:.1}", of.steps[0]),
                format!("{:.1}", of.tests[0]),
                format!("{:.3}", of.build.median),
                format!("{:.2}", 1e6 * of.rays[0].median),
                format!("{:.2}", 1e6 * of.rays[1].median),
            ]);
        }
    }
    Table {
        name: "times".into(),
        caption: "Table 1: build time and render time, BVH_i = 100, and counted work per camera ray. Medians of \
                  interleaved repetitions, one thread. Only the wide tree is not binary: one of its steps tests \
                  sixteen boxes, and one of its block tests up to sixteen triangles, which are counted individually."
            .into(),
        columns: columns(&[
            "scene",
            "structure",
            "build",
            "build, paper",
            "camera rays",
            "bounce rays",
            "render, paper",
            "steps",
            "tests",
            "build, s",
            "camera ray, µs",
            "bounce ray, µs",
        ]),
        rows,
    }
}

fn table_2(cast: &[Member], measured: &[Vec<Figures>]) -> Table {
    let percent = |share: f64| format!("{:.1}", 100.0 * share);
    let mut rows = Vec::new();
    for (pair, scene) in PAIRS.iter().zip(measured) {
        for i in [MSBVH, CLASSIC, CLASSIC + 1, PAPER, MOVING_PLANES, WIDE] {
            let of = &scene[i].of;
            let kd = i == PAPER || i == MOVING_PLANES;
            let of_paper = |k: usize| {
                let figure = pair.shares.filter(|_| i == PAPER).map(|shares| shares[k]);
                figure.map_or("–".to_string(), |figure| format!("{figure:.1}"))
            };
            let if_kd = |text: String| if kd { text } else { "–".into() };
            rows.push(vec![
                pair.ours.to_string(),
                cast[i].name.to_string(),
                format!("{:.2}", of.references as f64 / of.triangles.max(1) as f64),
                percent(of.duplicates()),
                of_paper(0),
                if_kd(percent(of.timed)),
                if_kd(percent(of.duplication_time)),
                of_paper(1),
                if_kd(percent(of.propagation_time)),
                of_paper(2),
            ]);
        }
    }
    Table {
        name: "duplicates".into(),
        caption: "Table 2: duplicates (references beyond the first of each triangle) and timed references (valid for \
                  part of the shutter), in per cent of all references; time spent in duplication and propagation, in \
                  per cent of the build."
            .into(),
        columns: columns(&[
            "scene",
            "structure",
            "references per triangle",
            "duplicates",
            "duplicates, paper",
            "timed",
            "duplication",
            "duplication, paper",
            "propagation",
            "propagation, paper",
        ]),
        rows,
    }
}

fn table_3(cast: &[Member], measured: &[Vec<Figures>]) -> Table {
    let mut rows = Vec::new();
    for (pair, scene) in PAIRS.iter().zip(measured) {
        for (i, (member, of)) in cast.iter().zip(scene).enumerate() {
            let memory = |k: usize| format!("{:.0}", 100.0 * f64::from(pair.memory[k]) / f64::from(pair.memory[0]));
            let paper = match i {
                0 => memory(0),
                MSBVH => memory(1),
                PAPER => memory(2),
                _ => "–".into(),
            };
            let per_triangle = |bytes: usize| format!("{:.0}", bytes as f64 / of.of.triangles.max(1) as f64);
            rows.push(vec![
                pair.ours.to_string(),
                member.name.to_string(),
                format!("{:.0}", 100.0 * of.of.bytes() as f64 / scene[0].of.bytes() as f64),
                paper,
                per_triangle(of.of.tree_bytes),
                per_triangle(of.of.triangle_bytes),
            ]);
        }
    }
    Table {
        name: "memory".into(),
        caption: "Table 3: memory, BVH_i = 100, and bytes per triangle. The leaves of the wide tree hold the vertices \
                  of the triangles, so no other copy is kept."
            .into(),
        columns: columns(&["scene", "structure", "memory", "memory, paper", "tree, bytes", "triangles, bytes"]),
        rows,
    }
}

/// What the paper's Table 1 says, and whether it is so here.
fn claims(measured: &[Vec<Figures>]) -> Vec<Item> {
    let scenes: Vec<(&Pair, &Vec<Figures>)> =
        PAIRS.iter().zip(measured).filter(|(pair, _)| pair.ours != "flake").collect();
    let claim = |text: &str, of: usize, to: usize| {
        faster(text, &scenes.iter().map(|(pair, f)| (pair.ours, f[of].times(), f[to].times())).collect::<Vec<_>>())
    };
    let to_fastest: Vec<_> = scenes.iter().map(|(pair, f)| (pair.ours, f[WIDE].times(), fastest(&f[..WIDE]))).collect();
    vec![
        claim("MSBVH renders in less time than BVH_i on every scene", MSBVH, 0),
        claim("the paper's MBKD renders in less time than BVH_i on every scene", PAPER, 0),
        claim("the paper's MBKD renders in less time than MSBVH on every scene", PAPER, MSBVH),
        faster("the wide tree renders in less time than the fastest binary structure on every scene", &to_fastest),
        Item::Text(
            "Where this differs from the paper: there, MBKD takes 55 to 65 % of the time of BVH_i. Here a k-d tree \
             takes two to four times as many steps as a BVH (columns of steps): its cells have no bounding boxes of \
             their own, so a ray visits empty cells and terminates later. The paper does not state the cost of a step \
             of its BVH_i; with vector instructions, testing two interpolated boxes does not cost several times as \
             much as testing a plane. Where displacements are large relative to the triangles (hairball, hand), the \
             tree reaches its reference budget with large leaves, and the number of tests grows; moving planes help \
             exactly there. Builds: k-d trees clip every triangle exactly at every plane and make up to eight \
             references of each, while a BVH_i makes none. Our BVH_i is built by binning, in a fraction of the time \
             per triangle that the paper reports, which raises all ratios to it."
                .into(),
        ),
    ]
}
