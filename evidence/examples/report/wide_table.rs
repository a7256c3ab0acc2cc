//! The second table of section 1: the binary structures laid out wide, beside the library's wide tree.

use crate::cast::{Member, compiled_for};
use crate::measure::{Figures, faster, fastest};
use crate::page::{Item, Table};
use mbkd::SimdLevel;
use mbkd_evidence::timing::Times;

/// What was measured over a scene: the structures of [`exact`](crate::cast::exact), and those of
/// [`laid_out_wide`](crate::cast::laid_out_wide).
pub struct WideScene<'a> {
    pub name: &'static str,
    pub binary: &'a [Figures],
    pub wide: &'a [Figures],
}

/// The places of structures in the cast that is laid out wide; the library's tree is the last.
const MSBVH: usize = 1;
const PAPER: usize = 4;
const PORTABLE: usize = 6;

/// Boxes of a node.
const WIDTH: f64 = 16.0;

/// The table and what is to be said of it.
pub fn items(exact: &[Member], cast: &[Member], scenes: &[WideScene]) -> Vec<Item> {
    let claim = |text: &str, of: usize, to: usize| {
        faster(text, &scenes.iter().map(|s| (s.name, s.wide[of].times(), s.wide[to].times())).collect::<Vec<_>>())
    };
    let to_fastest = |text: &str, ours: fn(&WideScene) -> [f64; 2]| {
        faster(text, &scenes.iter().map(|s| (s.name, ours(s), fastest(&s.wide[..PORTABLE]))).collect::<Vec<_>>())
    };
    vec![
        Item::Text(format!(
            "With sixteen-wide nodes: the same binary trees, collapsed until each node has sixteen children, as in \
             the wide tree of the library. Starting from both children of a node, the child with the largest surface \
             area is replaced by its own two. One loop interpolates and tests all sixteen boxes, which the compiler \
             turns into vector instructions; children are visited from near to far. Cells of k-d trees receive boxes \
             for this: each face is the tightest of the moving bounding box of the cell's triangles, the cell itself, \
             and what the triangles sweep within it. Children that hold for part of the shutter keep their time \
             intervals. Leaves are those of the binary tree, and triangles are tested one by one. The loop is compiled \
             for {}, like the whole program. The library selects its instruction set at run time, so its tree appears \
             twice: on {} (\"portable\"), to compare structures on equal terms, and on {}, its default.",
            compiled_for(),
            SimdLevel::BASELINE,
            SimdLevel::best()
        )),
        Item::Table(table(exact, cast, scenes)),
        claim("with wide nodes, MSBVH renders in less time than BVH_i on every scene", MSBVH, 0),
        claim("with wide nodes, the paper's MBKD renders in less time than BVH_i on every scene", PAPER, 0),
        claim("with wide nodes, the paper's MBKD renders in less time than MSBVH on every scene", PAPER, MSBVH),
        to_fastest(
            "the library's wide tree, portable, renders in less time than the fastest peer with wide nodes on every scene",
            |scene| scene.wide[PORTABLE].times(),
        ),
        to_fastest(
            "the library's wide tree with its default instruction set renders in less time than the fastest peer with wide nodes on every scene",
            |scene| scene.binary[PORTABLE].times(),
        ),
    ]
}

fn table(exact: &[Member], cast: &[Member], scenes: &[WideScene]) -> Table {
    let mut rows = Vec::new();
    for WideScene { name, binary, wide } in scenes {
        let head = &wide[0];
        let relative = |time: Times, to: Times| format!("{:.0}", 100.0 * time.median / to.median);
        let mut row = |structure: &str, of: &Figures, before: Option<&Figures>| {
            let to_binary =
                |kind: usize| before.map_or("–".into(), |before| relative(of.rays[kind], before.rays[kind]));
            let children = (of.of.nodes + of.of.leaves).saturating_sub(1) as f64 / of.of.nodes.max(1) as f64;
            rows.push(vec![
                name.to_string(),
                structure.to_string(),
                relative(of.build, head.build),
                relative(of.rays[0], head.rays[0]),
                relative(of.rays[1], head.rays[1]),
                to_binary(0),
                to_binary(1),
                format!("{:.1}", of.steps[0]),
                format!("{:.0}", WIDTH * of.nodes[0]),
                format!("{:.1}", of.tests[0]),
                format!("{children:.1}"),
                format!("{:.0}", 100.0 * of.of.bytes() as f64 / head.of.bytes() as f64),
                format!("{:.3}", of.build.median),
                format!("{:.2}", 1e6 * of.rays[0].median),
                format!("{:.2}", 1e6 * of.rays[1].median),
            ]);
        };
        for (i, (member, of)) in cast.iter().zip(*wide).enumerate() {
            row(member.name, of, binary[..PORTABLE].get(i));
        }
        row(exact[PORTABLE].name, &binary[PORTABLE], None);
    }
    let columns = [
        "scene",
        "structure",
        "build",
        "camera rays",
        "bounce rays",
        "camera rays, binary = 100",
        "bounce rays, binary = 100",
        "steps",
        "boxes",
        "tests",
        "children per node",
        "memory",
        "build, s",
        "camera ray, µs",
        "bounce ray, µs",
    ];
    Table {
        name: "wide".into(),
        caption: "With sixteen-wide nodes: build time, render time and memory, wide BVH_i = 100; render time relative \
                  to the binary form of the same tree; counted work per camera ray. Medians of interleaved \
                  repetitions, together with Table 1, one thread. Builds of the library's k-d trees include writing \
                  them to memory as a file and reading them back, which takes a small part of the time."
            .into(),
        columns: columns.map(String::from).to_vec(),
        rows,
    }
}
