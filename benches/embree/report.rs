//! The tables, in Markdown: per cell the best Embree configuration, the ratio, the bound and a verdict.

use crate::builds::Builds;
use crate::options::{Isa, Mode, Options};
use crate::run::{Cell, Measured};
use mbkd::SimdLevel;
use mbkd_evidence::timing::geometric_mean;

/// Required ratios on one thread of an AVX-512 machine.
mod bounds {
    pub const CELL_ROBUST: f64 = 1.15;
    pub const CELL_FAST: f64 = 1.0;
    pub const MEAN_ROBUST: f64 = 1.45;
    pub const MEAN_FAST: f64 = 1.3;
    pub const MEAN_AVX2: f64 = 1.0;
    pub const BATCH: f64 = 1.7;
    /// Build time and memory are ours / theirs and must stay below.
    pub const BUILD_TIME: f64 = 1.5;
    pub const MEMORY: f64 = 1.0;
    pub const PARALLEL_BUILD: f64 = 1.7;
}

/// Prints all tables.
pub fn print(options: &Options, measured: &Measured, builds: &[Builds]) {
    for &isa in &options.isa {
        for &mode in &options.modes {
            queries(options, measured, isa, mode);
        }
    }
    if options.details {
        details(&measured.cells);
    }
    work_table(measured);
    build_table(measured, builds);
    agreement_table(measured);
}

/// "**no**" stands out in a long table.
fn verdict(holds: bool) -> &'static str {
    if holds { "yes" } else { "**no**" }
}

/// Whether a ratio reaches a bound; empty if one side is missing.
fn reaches(ratio: f64, bound: f64) -> &'static str {
    if ratio.is_nan() { "" } else { verdict(ratio >= bound) }
}

/// Whether a share is within a bound; empty if one side is missing.
fn within(share: f64, bound: f64) -> &'static str {
    if share.is_nan() { "" } else { verdict(share <= bound) }
}

/// Two decimals, or a dash for a missing side.
fn two(x: f64) -> String {
    if x.is_nan() { "–".to_string() } else { format!("{x:.2}") }
}

fn mrays(rays: usize, seconds: f64) -> String {
    two(rays as f64 / seconds * 1e-6)
}

/// For every scene, kind and single or batch: the cell of Embree's best configuration.
fn hardest(measured: &Measured, isa: Isa, mode: Mode) -> Vec<&Cell> {
    let mut best: Vec<&Cell> = Vec::new();
    for cell in measured.cells.iter().filter(|c| (c.isa, c.mode) == (isa, mode)) {
        let same = |b: &&mut &Cell| (&b.scene, b.kind, b.batch) == (&cell.scene, cell.kind, cell.batch);
        match best.iter_mut().find(same) {
            // The ratio decides if both sides ran, Embree's own time otherwise.
            Some(b)
                if cell.turns.ratio < b.turns.ratio
                    || (cell.turns.ratio.is_nan() && cell.turns.theirs < b.turns.theirs) =>
            {
                *b = cell
            }
            Some(_) => {}
            None => best.push(cell),
        }
    }
    best
}

fn queries(options: &Options, measured: &Measured, isa: Isa, mode: Mode) {
    let best = hardest(measured, isa, mode);
    if best.is_empty() {
        return;
    }
    let level = if isa == Isa::Avx2 { "avx2".to_string() } else { SimdLevel::best().to_string() };
    let peer = match mode {
        _ if best.iter().all(|cell| cell.turns.theirs.is_nan()) => "no Embree",
        Mode::Robust => "Embree robust",
        Mode::Fast => "Embree fast",
    };
    println!("\n### Rays, {peer}, {level}\n");
    println!(
        "One thread, {} runs each in turns, medians, Mrays/s; Embree's best configuration per cell.\n",
        options.runs
    );
    println!("| scene | rays | number | ours | Embree | its configuration | ours / Embree | bound | holds |");
    println!("|---|---|---:|---:|---:|---|---:|---:|---|");
    let cell_bound = if mode == Mode::Robust { bounds::CELL_ROBUST } else { bounds::CELL_FAST };
    for cell in &best {
        let bound = if cell.batch { bounds::BATCH } else { cell_bound };
        let (ratio, rays) = (cell.turns.ratio, cell.rays);
        println!(
            "| {} | {}{} | {rays} | {} | {} | {} | {} | {bound:.2} | {} |",
            cell.scene,
            cell.kind.name(),
            if cell.batch { ", batch" } else { "" },
            mrays(rays, cell.turns.ours),
            mrays(rays, cell.turns.theirs),
            cell.config,
            two(ratio),
            if isa == Isa::Native { reaches(ratio, bound) } else { "" },
        );
    }
    let mean = geometric_mean(best.iter().filter(|c| !c.batch).map(|c| c.turns.ratio));
    let bound = match (isa, mode) {
        (Isa::Avx2, _) => bounds::MEAN_AVX2,
        (Isa::Native, Mode::Robust) => bounds::MEAN_ROBUST,
        (Isa::Native, Mode::Fast) => bounds::MEAN_FAST,
    };
    println!("| geometric mean | single rays | | | | | **{}** | {bound:.2} | {} |", two(mean), reaches(mean, bound));
}

fn details(cells: &[Cell]) {
    println!("\n### Every configuration\n");
    println!("| scene | rays | set | mode | configuration | ours | Embree | ours / Embree |");
    println!("|---|---|---|---|---|---:|---:|---:|");
    for c in cells {
        println!(
            "| {} | {}{} | {:?} | {:?} | {} | {} | {} | {} |",
            c.scene,
            c.kind.name(),
            if c.batch { ", batch" } else { "" },
            c.isa,
            c.mode,
            c.config,
            mrays(c.rays, c.turns.ours),
            mrays(c.rays, c.turns.theirs),
            two(c.turns.ratio),
        );
    }
}

/// The configuration that answers the scene's single rays fastest on average; in robust mode if measured.
fn best_on_average<'m>(measured: &'m Measured, scene: &str) -> Option<&'m str> {
    let single = |c: &&Cell| c.scene == scene && !c.batch && c.isa == Isa::Native;
    let mode = measured.cells.iter().filter(single).map(|c| c.mode).min_by_key(|&m| m as u8)?;
    let cells: Vec<&Cell> = measured.cells.iter().filter(single).filter(|c| c.mode == mode).collect();
    // Relative to ours at the same time if both ran: absolute times of different rounds compare less well.
    let weight = |c: &Cell| if c.turns.ratio.is_nan() { c.turns.theirs } else { c.turns.ratio };
    let mean = |name: &str| geometric_mean(cells.iter().filter(|c| c.config == name).map(|c| weight(c)));
    cells.iter().map(|c| c.config.as_str()).min_by(|a, b| mean(a).total_cmp(&mean(b)))
}

fn build_table(measured: &Measured, builds: &[Builds]) {
    if builds.is_empty() {
        return;
    }
    println!("\n### Builds and memory\n");
    println!("Embree with the configuration that is best for the scene's rays on average; its megabytes include");
    println!("vertex and index buffers (in brackets: those alone), ours the triangles.\n");
    println!(
        "| scene | threads | configuration | ours s | Embree s | ours / Embree | ≤ 1.5 | ours MB | Embree MB | ours / Embree | ≤ 1 |"
    );
    println!("|---|---:|---|---:|---:|---:|---|---:|---:|---:|---|");
    for b in builds {
        let threads = if b.threads == 0 { "all".to_string() } else { b.threads.to_string() };
        let best = best_on_average(measured, &b.scene);
        for t in b.theirs.iter().filter(|t| best.is_none_or(|name| name == t.config)) {
            let (time, memory) = (b.ours / t.seconds, b.our_bytes / t.bytes as f64);
            println!(
                "| {} | {threads} | {} | {} | {:.2} | {} | {} | {} | {:.1} ({:.1}) | {} | {} |",
                b.scene,
                t.config,
                two(b.ours),
                t.seconds,
                two(time),
                within(time, bounds::BUILD_TIME),
                two(megabytes(b.our_bytes)),
                megabytes(t.bytes as f64),
                megabytes(t.buffers as f64),
                two(memory),
                within(memory, bounds::MEMORY),
            );
        }
        if b.theirs.is_empty() {
            println!("| {} | {threads} | none | {:.2} | | | | {:.1} | | | |", b.scene, b.ours, megabytes(b.our_bytes));
        }
    }
    for one in builds.iter().filter(|b| b.threads == 1) {
        if let Some(all) = builds.iter().find(|b| b.threads == 0 && b.scene == one.scene) {
            let gain = one.ours / all.ours;
            println!(
                "\n{}: all cores build {gain:.2} × faster (at least {}: {}).",
                one.scene,
                bounds::PARALLEL_BUILD,
                verdict(gain >= bounds::PARALLEL_BUILD)
            );
        }
    }
}

fn work_table(measured: &Measured) {
    if measured.work.is_empty() {
        return;
    }
    println!("\n### What our queries do per ray\n");
    println!("| scene | rays | nodes | leaf blocks | triangle tests |");
    println!("|---|---|---:|---:|---:|");
    for (scene, kind, rays, work) in &measured.work {
        let per_ray = |n: u64| n as f64 / *rays as f64;
        let (nodes, leaves, tests) = (per_ray(work.nodes), per_ray(work.leaves), per_ray(work.primitive_tests));
        println!("| {scene} | {} | {nodes:.2} | {leaves:.2} | {tests:.2} |", kind.name());
    }
}

fn megabytes(bytes: f64) -> f64 {
    bytes / f64::from(1 << 20)
}

fn agreement_table(measured: &Measured) {
    if measured.agreements.is_empty() {
        return;
    }
    println!("\n### Answers against Embree's robust mode\n");
    println!(
        "Differences: the same distance on both sides (a shared edge, triangles on top of each other); a triangle"
    );
    println!("that only one side hits, passed within rounding of its edge; neither.\n");
    println!(
        "| scene | rays | number | same triangle or none | largest gap / scene size | same distance | edge, only ours | edge, only Embree | unexplained |"
    );
    println!("|---|---|---:|---:|---:|---:|---:|---:|---:|");
    for (scene, kind, a) in &measured.agreements {
        println!(
            "| {scene} | {} | {} | {} | {:.1e} | {} | {} | {} | {} |",
            kind.name(),
            a.rays,
            a.same,
            a.largest_gap,
            a.ties,
            a.edge_only_ours,
            a.edge_only_theirs,
            a.unexplained
        );
    }
}
