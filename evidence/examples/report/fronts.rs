//! Methods as lines of a plot of error over cost, and the claim that none lies below and to the left of ours.

use crate::page::{Axis, Item, Plot, Series, Style};
use mbkd_evidence::pareto::{Measured, refuting};

/// A method with its settings, a line of a plot.
pub struct Family {
    /// The method.
    pub label: String,
    /// Whether it is the library's.
    pub ours: bool,
    /// Its settings.
    pub settings: Vec<Measured>,
}

/// The claim that no peer lies below and to the left of a point of our front: costs less and errs no more. The text
/// lists what refutes it.
pub fn claim(about: &str, unit: &str, families: &[Family]) -> Item {
    let all = |ours: bool| -> Vec<Measured> {
        families.iter().filter(|f| f.ours == ours).flat_map(|f| f.settings.clone()).collect()
    };
    let told = |m: &Measured| format!("{} ({} {unit}, error {})", m.name, short(m.cost), short(m.error));
    let refuted: Vec<String> = refuting(&all(true), &all(false))
        .into_iter()
        .map(|(peer, ours)| format!("{} against {}", told(peer), told(ours)))
        .collect();
    let holds = refuted.is_empty();
    let mut text = format!("{about}: no peer lies below and to the left of ours (costs less and errs no more).");
    if !holds {
        text.push_str(&format!(" Refuted by {}.", refuted.join("; ")));
    }
    Item::Claim { text, holds }
}

/// Three digits of a number, as few as it takes.
pub fn short(x: f64) -> String {
    match x.abs() {
        0.0 => "0".into(),
        a if !(1e-3..1e6).contains(&a) => format!("{x:.2e}"),
        a if a >= 100.0 => format!("{x:.0}"),
        a if a >= 10.0 => format!("{x:.1}"),
        a if a >= 1.0 => format!("{x:.2}"),
        _ => format!("{x:.3}"),
    }
}

/// A power of ten below all errors that are not zero, where a logarithmic axis draws those that are.
pub fn floor(errors: impl IntoIterator<Item = f64>) -> f64 {
    let least = errors.into_iter().filter(|&e| e > 0.0).fold(1e-2, f64::min);
    10f64.powf((least.log10() - 0.5).floor())
}

/// The plot of error over cost, both logarithmic. Errors of zero are drawn at the [`floor`], which the caption says.
pub fn plot(name: String, title: String, about: &str, [x, y]: [&str; 2], families: &[Family]) -> Plot {
    let errors = || families.iter().flat_map(|f| &f.settings).map(|m| m.error);
    let floor = floor(errors());
    let zeros =
        if errors().any(|e| e == 0.0) { format!(" Errors of zero are drawn at {floor:.0e}.") } else { String::new() };
    let series = families.iter().map(|family| Series {
        label: family.label.clone(),
        points: family.settings.iter().map(|m| (m.cost, m.error.max(floor))).collect(),
        style: Style::LineAndPoints,
        ours: family.ours,
    });
    Plot {
        name,
        title,
        caption: format!("{about}{zeros}"),
        x: Axis { label: x.into(), log: true },
        y: Axis { label: y.into(), log: true },
        series: series.collect(),
    }
}
