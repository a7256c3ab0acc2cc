//! What many rows have in common, and the worst ones.

use crate::measure::Row;
use mbkd_evidence::timing::geometric_mean;

/// Automatic choices may cost this many times the least that a requested number of time slices costs.
const TARGET: f64 = 1.07;

/// How many of the worst rows are repeated.
const WORST: usize = 8;

/// Geometric means over some rows.
pub fn means(title: &str, rows: &[&Row]) {
    let mean = |of: &dyn Fn(&Row) -> Option<f64>| geometric_mean(rows.iter().filter_map(|row| of(row)));
    let worst = rows.iter().map(|row| row.to_best).fold(0.0, f64::max);
    println!(
        "{title:24}{:7} kinds: build {:6.2}, the same requested {:6.2}, ratio {:5.3}, of the best {:6.2}; work {:6.3}, / best {:.4} (worst {worst:.2}, {} above {TARGET}), / best of all {:.4}",
        rows.len(),
        mean(&|row| Some(row.build)),
        mean(&|row| row.requested),
        mean(&|row| Some(row.build / row.requested?)),
        mean(&|row| Some(row.build_of_best)),
        mean(&|row| Some(row.work)),
        mean(&|row| Some(row.to_best)),
        rows.iter().filter(|row| row.to_best > TARGET).count(),
        mean(&|row| Some(row.to_best_of_all)),
    );
}

/// The rows with the most work relative to the best, and with the longest decisions.
pub fn worst(rows: &[Row]) {
    let top = |title: &str, by: &dyn Fn(&Row) -> f64| {
        let mut rows: Vec<&Row> = rows.iter().collect();
        rows.sort_by(|a, b| by(b).total_cmp(&by(a)));
        println!("\n{title}");
        for row in rows.into_iter().take(WORST) {
            println!("  {:5.2}  {} of {}: {}, not {}", by(row), row.kind, row.points, row.chosen, row.best[0]);
        }
    };
    top("Most work relative to the best number of time slices within the budget:", &|row| row.to_best);
    top("Longest builds relative to the chosen structure on request:", &|row| {
        row.requested.map_or(0.0, |requested| row.build / requested)
    });
    top("Longest builds relative to static ones:", &|row| row.build);
}
