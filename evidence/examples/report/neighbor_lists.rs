//! Neighbour lists that serve several steps: pairs missed by a guess, and what certainty costs.

use crate::page::{Item, Section, Style, Table};
use crate::pareto::{Family, Measured, claim, plot, short};
use crate::particle_walk::{Kept, Maker, Upkeep, Walk, keep};
use crate::race::on_one_thread;
use crate::run::{Run, Times};
use std::error::Error;

/// Skins, in radii.
const SKINS: [f32; 4] = [0.05, 0.1, 0.2, 0.4];
/// Steps after which guessed lists are made anew.
const EVERY: [usize; 3] = [2, 4, 8];

/// A way to keep lists, in a family.
struct Way {
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
    ("skin watched in every step, mbkd's lists", false),
    ("skin watched in every step, linkcell's lists", false),
];

fn ways() -> Vec<Way> {
    let mut ways =
        vec![Way { family: 1, name: "mbkd, every step".into(), maker: Maker::Mbkd, upkeep: Upkeep::EveryStep }];
    for skin in SKINS {
        let name = format!("mbkd, certified, skin {skin}");
        ways.push(Way { family: 0, name, maker: Maker::Mbkd, upkeep: Upkeep::Certified { skin } });
        for (maker, place) in [(Maker::Mbkd, 0), (Maker::Linkcell, 1)] {
            let name = format!("watched, skin {skin}, {maker:?}");
            ways.push(Way { family: 4 + place, name, maker, upkeep: Upkeep::Watched { skin } });
            for every in EVERY {
                let name = format!("guess, skin {skin}, {every} steps, {maker:?}");
                ways.push(Way { family: 2 + place, name, maker, upkeep: Upkeep::Guessed { skin, every } });
            }
        }
    }
    ways
}

/// The section.
pub fn run(run: &Run) -> Result<Section, Box<dyn Error>> {
    let (n, steps, rounds) = run.pick((5000, 25, 3), (100_000, 65, 3));
    let ways = ways();
    run.begin("neighbor-lists", rounds + 1);
    run.step("particles");
    let walk = Walk::new(n, steps, run.seed)?;
    let mut times = vec![Vec::new(); ways.len()];
    let mut last = vec![Kept::default(); ways.len()];
    for round in 0..rounds {
        run.step(&format!("round {} of {rounds}", round + 1));
        let kept =
            on_one_thread(|| ways.iter().map(|way| keep(&walk, way.maker, way.upkeep)).collect::<Result<Vec<_>, _>>())?;
        for ((times, last), kept) in times.iter_mut().zip(&mut last).zip(kept) {
            times.push(kept.seconds);
            *last = kept;
        }
    }
    let cost = |times: &Vec<f64>| Times::of(times.clone()).median * 1e9 / (n * steps) as f64;
    let measured: Vec<Measured> = ways
        .iter()
        .zip(&times)
        .zip(&last)
        .map(|((way, times), kept)| Measured { name: way.name.clone(), cost: cost(times), error: kept.missed })
        .collect();
    let of = |family: usize| {
        let own = ways.iter().zip(&measured).filter(move |(way, _)| way.family == family);
        own.map(|(_, m)| m.clone()).collect::<Vec<_>>()
    };
    let families: Vec<Family> = FAMILIES
        .iter()
        .enumerate()
        .map(|(i, &(label, ours))| Family { label: label.into(), ours, settings: of(i) })
        .collect();
    let mean = walk.pairs.iter().sum::<usize>() as f64 / (n * steps) as f64;
    let about = format!(
        "{n} particles, {steps} steps, {mean:.0} neighbours each. Their speeds differ tenfold, and each is pushed at random \
         in every step. Lists hold the pairs within the radius and a skin, and serve until they are made anew. Cost is that of making \
         lists and of looking at each listed pair in every step, on one thread."
    );
    let mut items = vec![Item::Text(format!(
        "{about} A *guess* makes lists anew after a fixed number of steps. A *watched* skin is compared with the two \
         farthest ways since the lists were made, and so misses nothing. *Certified* lists come with the time until which \
         they hold every pair: found from the velocities, with what the largest acceleration can add; what is needed is \
         known when the lists are made, not afterwards. A guess that happened to miss nothing here is drawn as such; \
         that it would, nobody knew."
    ))];
    let settled = |families: &[Family], label: &str| {
        let caption = format!("{about} Skins are {SKINS:?} of the radius, guesses {EVERY:?} steps.");
        let axes = ["ns per particle and step", "share of pairs missed"];
        let mut plot = plot("missed".into(), label.into(), &caption, axes, families);
        // Two settings each: no line leads from one to the next.
        plot.series.iter_mut().for_each(|series| series.style = Style::Points);
        Item::Plot(plot)
    };
    items.push(settled(&families, "Pairs missed by neighbour lists"));
    // First what another library offers, then what remains of a claim when its rivals use our lists without certificate.
    let (foreign, own): (Vec<Family>, Vec<Family>) =
        families.into_iter().partition(|family| family.ours || family.label.contains("linkcell"));
    items.push(claim("Against linkcell's lists", "ns", &foreign));
    let ours = foreign.into_iter().filter(|family| family.ours);
    let own: Vec<Family> = ours.chain(own).collect();
    items.push(claim("Against our own lists without certificate", "ns", &own));
    let rows = measured
        .iter()
        .zip(&last)
        .map(|(m, kept)| vec![m.name.clone(), short(m.cost), short(m.error), kept.made.to_string()]);
    items.push(Item::Table(Table {
        name: "ways".into(),
        caption: format!("All ways to keep lists for {steps} steps."),
        columns: ["way", "ns per particle and step", "share of pairs missed", "lists made"].map(String::from).to_vec(),
        rows: rows.collect(),
    }));
    Ok(Section { id: "neighbor-lists", title: "Neighbour lists: missed pairs against time", items })
}
