//! What one method costs and how much it errs, and whether another one does better in both.

use crate::page::{Axis, Item, Plot, Series, Style};

/// One method with one setting, measured.
#[derive(Clone, Debug)]
pub struct Measured {
    /// Method and setting.
    pub name: String,
    /// What it costs, as on the x axis.
    pub cost: f64,
    /// How much it errs, as on the y axis.
    pub error: f64,
}

/// A method with its settings, a line of a plot.
pub struct Family {
    /// The method.
    pub label: String,
    /// Whether it is the library's.
    pub ours: bool,
    /// Its settings.
    pub settings: Vec<Measured>,
}

/// The settings that no other of them beats, cheapest first.
pub fn front(settings: &[Measured]) -> Vec<&Measured> {
    let beaten = |m: &Measured| {
        settings.iter().any(|other| {
            other.cost <= m.cost && other.error <= m.error && (other.cost < m.cost || other.error < m.error)
        })
    };
    let mut front: Vec<&Measured> = settings.iter().filter(|m| !beaten(m)).collect();
    front.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    front
}

/// The claim that no peer lies below and to the left of a point of our front: costs less and errs no more. The text
/// lists what refutes it.
pub fn claim(about: &str, unit: &str, families: &[Family]) -> Item {
    let all_ours: Vec<Measured> = families.iter().filter(|f| f.ours).flat_map(|f| f.settings.clone()).collect();
    let mut refuted = Vec::new();
    for peer in families.iter().filter(|f| !f.ours).flat_map(|f| &f.settings) {
        let better = |ours: &&&Measured| peer.cost < ours.cost && peer.error <= ours.error;
        if let Some(ours) = front(&all_ours).iter().find(better) {
            refuted.push(format!(
                "{} ({} {unit}, error {}) against {} ({} {unit}, error {})",
                peer.name,
                short(peer.cost),
                short(peer.error),
                ours.name,
                short(ours.cost),
                short(ours.error)
            ));
        }
    }
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
