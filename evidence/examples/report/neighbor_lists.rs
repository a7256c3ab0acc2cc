//! Neighbour lists that serve several steps: pairs missed by a guess, and what certainty costs.

use crate::fronts::{Family, claim, plot, short};
use crate::page::{Item, Section, Style, Table};
use crate::particle_walk::{Kept, Maker, Upkeep, Walk, keep};
use crate::race::on_one_thread;
use crate::run::Run;
use mbkd_evidence::pareto::Measured;
use mbkd_evidence::timing::Times;
use std::error::Error;

/// Skins, in radii.
const SKINS: [f32; 3] = [0.1, 0.2, 0.4];
/// Steps after which guessed lists are made anew.
const EVERY: [usize; 3] = [2, 4, 8];

/// A method of maintaining lists, in a family.
struct Method {
    family: usize,
    name: String,
    maker: Maker,
    upkeep: Upkeep,
}

/// Labels of the families, and whether they are the library's.
const FAMILIES: [(&str, bool); 6] = [
    ("mbkd, certified lists", true),
    ("mbkd, new lists in every step", true),
    ("guessed skin and steps, mbkd's lists", false),
    ("guessed skin and steps, linkcell's lists", false),
    ("skin monitored in every step, mbkd's lists", false),
    ("skin monitored in every step, linkcell's lists", false),
];

fn methods() -> Vec<Method> {
    let mut methods =
        vec![Method { family: 1, name: "mbkd, every step".into(), maker: Maker::Mbkd, upkeep: Upkeep::EveryStep }];
    for skin in SKINS {
        let name = format!("mbkd, certified, skin {skin}");
        methods.push(Method { family: 0, name, maker: Maker::Mbkd, upkeep: Upkeep::Certified { skin } });
        for (maker, place) in [(Maker::Mbkd, 0), (Maker::Linkcell, 1)] {
            let name = format!("monitored, skin {skin}, {maker:?}");
            methods.push(Method { family: 4 + place, name, maker, upkeep: Upkeep::Monitored { skin } });
            for every in EVERY {
                let name = format!("guess, skin {skin}, {every} steps, {maker:?}");
                methods.push(Method { family: 2 + place, name, maker, upkeep: Upkeep::Guessed { skin, every } });
            }
        }
    }
    methods
}

/// The section.
pub fn run(run: &Run) -> Result<Section, Box<dyn Error>> {
    let (n, steps, rounds) = run.pick((5000, 25, 3), (30_000, 49, 3));
    let methods = methods();
    run.begin("neighbor-lists", rounds + 1);
    run.step("particles");
    let walk = Walk::new(n, steps, run.seed)?;
    let mut times = vec![Vec::new(); methods.len()];
    let mut last = vec![Kept::default(); methods.len()];
    for round in 0..rounds {
        run.step(&format!("round {} of {rounds}", round + 1));
        let kept = on_one_thread(|| {
            methods.iter().map(|method| keep(&walk, method.maker, method.upkeep)).collect::<Result<Vec<_>, _>>()
        })?;
        for ((times, last), kept) in times.iter_mut().zip(&mut last).zip(kept) {
            times.push(kept.seconds);
            *last = kept;
        }
    }
    let measured: Vec<Measured> = (methods.iter().zip(times).zip(&last))
        .map(|((method, times), kept)| {
            let cost = Times::of(times).median * 1e9 / (n * steps) as f64;
            Measured { name: method.name.clone(), cost, error: kept.missed }
        })
        .collect();
    let mean = walk.pairs.iter().sum::<usize>() as f64 / (n * steps) as f64;
    let about = format!(
        "{n} particles, {steps} steps, {mean:.0} neighbours each. Speeds differ tenfold, and every particle receives \
         a random push in every step. Lists hold the pairs within the radius plus a skin and are reused until they are \
         rebuilt. The cost is that of building lists and of checking each listed pair in every step, on one thread."
    );
    Ok(Section {
        id: "neighbor-lists",
        title: "6. Neighbour lists: missed pairs against time",
        items: items(&about, &methods, &measured, &last),
    })
}

/// What the section says.
fn items(about: &str, methods: &[Method], measured: &[Measured], last: &[Kept]) -> Vec<Item> {
    let family = |(i, (label, ours)): (usize, (&str, bool))| {
        let own = methods.iter().zip(measured).filter(|(method, _)| method.family == i);
        Family { label: label.into(), ours, settings: own.map(|(_, m)| m.clone()).collect() }
    };
    let families: Vec<Family> = FAMILIES.into_iter().enumerate().map(family).collect();
    let caption = format!("Skins: {SKINS:?} of the radius. Steps between guessed rebuilds: {EVERY:?}.");
    let axes = ["ns per particle and step", "share of pairs missed"];
    let mut plot = plot("missed".into(), "Pairs missed by neighbour lists".into(), &caption, axes, &families);
    // A skin and a number of steps each: no line leads from one setting to the next.
    plot.series.iter_mut().for_each(|series| series.style = Style::Points);
    // First what another library offers, then what remains of the claim when rivals use our lists without certificate.
    let (foreign, own): (Vec<Family>, Vec<Family>) =
        families.into_iter().partition(|family| family.ours || family.label.contains("linkcell"));
    let against_foreign = claim("Against linkcell's lists", "ns", &foreign);
    let own: Vec<Family> = foreign.into_iter().filter(|family| family.ours).chain(own).collect();
    let row =
        |(m, kept): (&Measured, &Kept)| vec![m.name.clone(), short(m.cost), short(m.error), kept.made.to_string()];
    vec![
        Item::Text(format!(
            "{about} A guessed skin rebuilds the lists after a fixed number of steps. A monitored skin compares the \
             two largest displacements since the last rebuild with the skin, and so misses nothing. A certified list \
             carries the time until which it is complete, derived from the velocities and a bound on the acceleration: \
             that time is known when the list is built, not afterwards. A guess that happened to miss no pair in this \
             run is drawn at the bottom, but nothing guaranteed it."
        )),
        Item::Plot(plot),
        against_foreign,
        claim("Against our own lists without certificate", "ns", &own),
        Item::Text(what_certainty_costs(measured, methods)),
        Item::Table(Table {
            name: "ways".into(),
            caption: "All ways to keep lists.".into(),
            columns: ["way", "ns per particle and step", "share of pairs missed", "lists made"]
                .map(String::from)
                .to_vec(),
            rows: measured.iter().zip(last).map(row).collect(),
        }),
    ]
}

/// The cheapest methods of each kind that miss nothing, relative to new lists in every step.
fn what_certainty_costs(measured: &[Measured], methods: &[Method]) -> String {
    let least = |is_in: &dyn Fn(&Method) -> bool| {
        let own = methods.iter().zip(measured).filter(|(method, m)| is_in(method) && m.error == 0.0);
        own.map(|(_, m)| m.cost).fold(f64::INFINITY, f64::min)
    };
    let every = least(&|method| method.upkeep == Upkeep::EveryStep);
    let certified = least(&|method| matches!(method.upkeep, Upkeep::Certified { .. }));
    let monitored = least(&|method| matches!(method.upkeep, Upkeep::Monitored { .. }) && method.maker == Maker::Mbkd);
    format!(
        "Methods that miss nothing, with our lists: relative to rebuilding in every step, the cheapest certified \
         lists cost {} times as much and the cheapest monitored ones {} times. A certificate computes, in f64, the \
         first time at which any nearby pair could come within the radius, which is more work than a list. It is meant \
         for programs that cannot check displacements in every step.",
        short(certified / every),
        short(monitored / every)
    )
}
