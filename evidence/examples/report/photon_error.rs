//! How far estimates of the density of light are off at a place and time, over what a gather costs; bias and variance apart.

use crate::fronts::{Family, claim, plot, short};
use crate::page::{Axis, Item, Plot, Section, Series, Style, Table};
use crate::photon_scene::{COUNTS, Method, PASSES, Photons, Place, WINDOWS, density, places};
use crate::race::on_one_thread;
use crate::run::Run;
use mbkd_evidence::pareto::{Measured, front};
use mbkd_evidence::timing::Times;
use std::error::Error;
use std::hint::black_box;
use std::time::Instant;

/// How large everything is.
#[derive(Clone, Copy)]
struct Size {
    photons: usize,
    maps: usize,
    places: usize,
    rounds: usize,
    /// Seconds of a method's turn.
    turn: f64,
}

/// All methods; those with too few photons per pass left out.
fn methods(photons: usize) -> Vec<Method> {
    let mut methods = Vec::new();
    for k in COUNTS {
        methods.push(Method::Ignored { k });
        for window in 0..WINDOWS.len() {
            methods.push(Method::RayTime { k, window });
            methods.push(Method::Filtered { k, window });
        }
        for (passes, of) in PASSES.into_iter().enumerate() {
            if photons / of >= 4 * k {
                methods.push(Method::PerPass { k, passes });
            }
        }
    }
    methods
}

fn name(method: Method) -> String {
    match method {
        Method::RayTime { k, window } => format!("mbkd, k = {k}, half window {}", WINDOWS[window]),
        Method::PerPass { k, passes } => format!("{} passes, k = {k}", PASSES[passes]),
        Method::Ignored { k } => format!("time ignored, k = {k}"),
        Method::Filtered { k, window } => format!("kiddo filtered, k = {k}, half window {}", WINDOWS[window]),
    }
}

/// Errors of a method, relative to the root of the mean squared density.
#[derive(Clone, Copy, Debug, Default)]
struct Errors {
    bias: f64,
    deviation: f64,
}

impl Errors {
    fn total(self) -> f64 {
        self.bias.hypot(self.deviation)
    }
}

/// Sums over independent maps of what a method estimates at each place.
#[derive(Clone)]
struct Sums {
    of: Vec<f64>,
    squares: Vec<f64>,
}

/// The section.
pub fn run(run: &Run) -> Result<Section, Box<dyn Error>> {
    let size = run.pick(
        Size { photons: 40_000, maps: 12, places: 400, rounds: 3, turn: 0.006 },
        Size { photons: 400_000, maps: 32, places: 1000, rounds: 5, turn: 0.02 },
    );
    let places = places(size.places, run.seed);
    let methods = methods(size.photons);
    run.begin("photon-error", size.maps + 1);
    let empty = Sums { of: vec![0.0; places.len()], squares: vec![0.0; places.len()] };
    let mut sums = vec![empty; methods.len()];
    for map in 0..size.maps {
        run.step(&format!("photon map {} of {}", map + 1, size.maps));
        let seed = seed_of(run.seed, map);
        on_one_thread(|| add_map(size, seed, &methods, &places, &mut sums))?;
    }
    run.step("times");
    let errors: Vec<Errors> = sums.iter().map(|sums| errors(sums, &places, size.maps)).collect();
    let seed = seed_of(run.seed, 0);
    let (times, apart) = on_one_thread(|| times(size, seed, &methods, &places))?;
    Ok(section(size, &methods, &errors, &times, apart))
}

/// The seed of a photon map.
fn seed_of(seed: u64, map: usize) -> u64 {
    seed.wrapping_mul(1_000_003).wrapping_add(map as u64)
}

fn add_map(
    size: Size,
    seed: u64,
    methods: &[Method],
    places: &[Place],
    sums: &mut [Sums],
) -> Result<(), Box<dyn Error>> {
    let mut photons = Photons::new(size.photons, seed)?;
    for (&method, sums) in methods.iter().zip(sums) {
        // The same estimates as the library's, at many times the cost; `times` compares them.
        if matches!(method, Method::Filtered { .. }) {
            continue;
        }
        for (i, &place) in places.iter().enumerate() {
            let estimate = photons.estimate(method, place);
            sums.of[i] += estimate;
            sums.squares[i] += estimate * estimate;
        }
    }
    Ok(())
}

/// Bias and standard deviation over all places. The squared bias is freed of what the scatter of a mean adds to it.
fn errors(sums: &Sums, places: &[Place], maps: usize) -> Errors {
    let (n, mut bias, mut variance, mut light) = (maps as f64, 0.0, 0.0, 0.0);
    for ((sum, square), &place) in sums.of.iter().zip(&sums.squares).zip(places) {
        let (mean, truth) = (sum / n, density(place));
        let own = (square - sum * mean).max(0.0) / (n - 1.0);
        bias += (mean - truth).powi(2) - own / n;
        variance += own;
        light += truth * truth;
    }
    Errors { bias: (bias.max(0.0) / light).sqrt(), deviation: (variance / light).sqrt() }
}

/// Nanoseconds per estimate of each method, interleaved, and how far filtered estimates are from ours at most, relatively.
fn times(size: Size, seed: u64, methods: &[Method], places: &[Place]) -> Result<(Vec<f64>, f64), Box<dyn Error>> {
    let mut photons = Photons::new(size.photons, seed)?;
    let mut apart: f64 = 0.0;
    let mut strides = Vec::new();
    for &method in methods {
        let start = Instant::now();
        for &place in places.iter().step_by(8) {
            let estimate = photons.estimate(method, place);
            if let Method::Filtered { k, window } = method {
                let ours = photons.estimate(Method::RayTime { k, window }, place);
                apart = apart.max((estimate / ours - 1.0).abs());
            }
        }
        let all = start.elapsed().as_secs_f64() * 8.0;
        strides.push(((all / size.turn).ceil() as usize).clamp(1, places.len() / 20));
    }
    let mut times = vec![Vec::new(); methods.len()];
    for _ in 0..size.rounds {
        for ((&method, &stride), times) in methods.iter().zip(&strides).zip(&mut times) {
            let start = Instant::now();
            for &place in places.iter().step_by(stride) {
                black_box(photons.estimate(method, place));
            }
            times.push(start.elapsed().as_nanos() as f64 / places.len().div_ceil(stride) as f64);
        }
    }
    Ok((times.into_iter().map(|times| Times::of(times).median).collect(), apart))
}

fn section(size: Size, methods: &[Method], errors: &[Errors], times: &[f64], apart: f64) -> Section {
    // Filtered estimates err like ours.
    let error_of = |method: Method| {
        let as_ours = match method {
            Method::Filtered { k, window } => Method::RayTime { k, window },
            other => other,
        };
        methods.iter().position(|m| *m == as_ours).map_or(Errors::default(), |i| errors[i])
    };
    let families = families(methods, times, &error_of);
    let fronts: Vec<Family> = families
        .iter()
        .map(|f| Family { settings: front(&f.settings).into_iter().cloned().collect(), label: f.label.clone(), ..*f })
        .collect();
    let mut best = plot(
        "front".into(),
        "Photon density: error against time".into(),
        "The best settings of each method over k = 10 to 200 and over all windows or numbers of passes.",
        ["ns per gather", "relative rms error of the density"],
        &fronts,
    );
    // All errors are of one magnitude, and none is zero.
    best.y.log = false;
    let mut items = vec![
        Item::Text(format!(
            "Half of the light falls evenly on a floor, half into a spot of a tenth of its size that moves by five of \
             its radii during the shutter, so the true density is known at every place and time. {} photons per map, \
             {} independent maps, {} query positions in and around the spot at random times. An estimate sums k \
             photons over the disc up to the next photon and over the time window. One time per pass: the same number \
             of photons divided among P passes, each with one time; the pass with the nearest time answers. Errors are \
             root mean squares over all query positions, relative to the root mean square of the density. kiddo's \
             trees are two-dimensional here. Filtering kiddo's results by time gives the same estimates as our gather \
             at ray time, up to {apart:.0e} of them.",
            size.photons, size.maps, size.places
        )),
        Item::Plot(best),
        claim("Photon density", "ns", &families),
    ];
    items.push(parts(
        "window",
        "Bias and deviation over the window, k = 50",
        "half window, or half the time from pass to pass, in shutters",
        (0..WINDOWS.len()).map(|window| (f64::from(WINDOWS[window]), Method::RayTime { k: 50, window })).collect(),
        PASSES
            .iter()
            .enumerate()
            .map(|(passes, &of)| (0.5 / of as f64, Method::PerPass { k: 50, passes }))
            .filter(|(_, method)| methods.contains(method))
            .collect(),
        &error_of,
    ));
    items.push(parts(
        "photons",
        "Bias and deviation over k, half window 0.02 or 16 passes",
        "photons of an estimate (k)",
        COUNTS.iter().map(|&k| (k as f64, Method::RayTime { k, window: 2 })).collect(),
        COUNTS
            .iter()
            .map(|&k| (k as f64, Method::PerPass { k, passes: 2 }))
            .filter(|(_, m)| methods.contains(m))
            .collect(),
        &error_of,
    ));
    let rows = methods.iter().zip(times).map(|(&method, &ns)| {
        let e = error_of(method);
        vec![name(method), short(ns), short(e.total()), short(e.bias), short(e.deviation)]
    });
    items.push(Item::Table(Table {
        name: "methods".into(),
        caption: "All settings; errors relative, as in the plots.".into(),
        columns: ["method", "ns per gather", "error", "bias", "standard deviation"].map(String::from).to_vec(),
        rows: rows.collect(),
    }));
    Section { id: "photon-error", title: "5. Photon density error against time", items }
}

/// The methods with all their settings.
fn families(methods: &[Method], times: &[f64], error_of: &dyn Fn(Method) -> Errors) -> Vec<Family> {
    type IsIn = fn(&Method) -> bool;
    let kinds: [(&str, bool, IsIn); 4] = [
        ("mbkd, gathered at ray time", true, |m| matches!(m, Method::RayTime { .. })),
        ("one time per pass, 1 to 256 passes (kiddo)", false, |m| matches!(m, Method::PerPass { .. })),
        ("time ignored (kiddo)", false, |m| matches!(m, Method::Ignored { .. })),
        ("kiddo, filtered by time", false, |m| matches!(m, Method::Filtered { .. })),
    ];
    kinds
        .into_iter()
        .map(|(label, ours, is_in)| {
            let own = methods.iter().zip(times).filter(|(m, _)| is_in(m));
            let settings =
                own.map(|(&m, &cost)| Measured { name: name(m), cost, error: error_of(m).total() }).collect();
            Family { label: label.into(), ours, settings }
        })
        .collect()
}

/// The plot of bias and deviation of our gather and of passes.
fn parts(
    file: &str,
    title: &str,
    label: &str,
    ours: Vec<(f64, Method)>,
    passes: Vec<(f64, Method)>,
    error_of: &dyn Fn(Method) -> Errors,
) -> Item {
    let series = |label: &str, ours: bool, style: Style, at: &[(f64, Method)], part: fn(Errors) -> f64| Series {
        label: label.into(),
        points: at.iter().map(|&(x, method)| (x, part(error_of(method)))).collect(),
        style,
        ours,
    };
    Item::Plot(Plot {
        name: file.into(),
        title: title.into(),
        caption: "Bias and standard deviation apart; the error is the root of the sum of their squares.".into(),
        x: Axis { label: label.into(), log: true },
        y: Axis { label: "relative rms".into(), log: false },
        series: vec![
            series("gathered at ray time: bias", true, Style::LineAndPoints, &ours, |e| e.bias),
            series("gathered at ray time: standard deviation", true, Style::Line, &ours, |e| e.deviation),
            series("one time per pass: bias", false, Style::LineAndPoints, &passes, |e| e.bias),
            series("one time per pass: standard deviation", false, Style::Dashed, &passes, |e| e.deviation),
        ],
    })
}
