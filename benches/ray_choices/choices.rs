//! The automatic choice against every manual setting.

use crate::Args;
use crate::measure::{Built, COLUMNS, Row};
use mbkd::{BuildParams, Division, WideParams};
use mbkd_evidence::scene_rays::Rays;
use mbkd_scenes::Scene;

/// Every temporal split as a manual setting, each with pre-splitting where it pays and without.
fn by_hand() -> Vec<(String, BuildParams)> {
    let divisions = [
        Division::Whole,
        Division::SharedLeaves(2),
        Division::SharedLeaves(4),
        Division::SharedLeaves(8),
        Division::SeparateTrees(2),
        Division::SeparateTrees(4),
        Division::SeparateTrees(8),
        Division::SeparateTrees(16),
    ];
    let mut all = Vec::new();
    for division in divisions {
        let name = match division {
            Division::SharedLeaves(n) => format!("{n} slices with shared leaves"),
            Division::SeparateTrees(n) => format!("{n} separate trees"),
            _ => "whole".into(),
        };
        let params = WideParams { division, ..WideParams::default() };
        all.push((
            format!("{name} without pre-splits"),
            BuildParams::wide(WideParams { max_references: 1.0, ..params }),
        ));
        all.push((name, BuildParams::wide(params)));
    }
    all
}

/// Prints the speed of the trees of each manual setting relative to the automatic one.
pub fn compare(args: &Args, scene: &Scene, automatic: &Built, rays: &Rays) {
    let n = scene.triangles();
    println!("\n## {}, {n} triangles\n", scene.name);
    println!("Speed of forced settings, relative to the automatic tree's.\n");
    println!("| setting | bytes per triangle | build s | {COLUMNS} |\n|---|---|---|---|---|---|---|---|---|");
    println!("| automatic | {:.0} | {:.2} | 1 | 1 | 1 | 1 | 1 | 1 |", automatic.bytes_per(n), automatic.seconds);
    let budget = f64::from(WideParams::default().bytes_per_primitive);
    let own = automatic.work(rays);
    let (mut best, mut last) = (Row([1.0; 6]), None);
    let wanted = |name: &str| args.only.is_empty() || args.only.iter().any(|part| name.contains(part.as_str()));
    for (name, params) in by_hand().into_iter().filter(|(name, _)| wanted(name)) {
        let built = match Built::new(&scene.meshes, &params) {
            Ok(built) => built,
            Err(error) => {
                println!("| {name} | {error} |");
                continue;
            }
        };
        // If nothing is pre-split, both settings give the same tree.
        let work = built.work(rays);
        if last.replace(work) == Some(work) {
            continue;
        }
        let speed = Row::speed(&built, automatic, rays, args.runs);
        let bytes = built.bytes_per(n);
        // The same tree under another name shows how far the figures can be trusted.
        let same = if work == own { " (the same tree)" } else { "" };
        println!("| {name}{same} | {bytes:.0} | {:.2} | {speed} |", built.seconds);
        if bytes <= budget && work != own {
            best = best.max(speed);
        }
    }
    println!("| best within {budget} bytes | | | {best} |");
}
