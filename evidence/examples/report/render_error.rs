//! Section 3: how fast the error of a picture falls, for every structure.

use crate::cast::{Member, exact, laid_out_wide, scene};
use crate::page::{Axis, Item, Plot, Section, Series, Style, Table};
use crate::run::Run;
use crate::shading::Shading;
use mbkd::{BuildParams, Hit, Ray};
use mbkd_evidence::peers::{Peer, PeerError, Structure};
use mbkd_evidence::timing::{Times, on_one_thread, timed};
use mbkd_scenes::Random;
use mbkd_scenes::Scene;
use rayon::prelude::*;
use std::error::Error;

/// Numbers of time slices.
const SLICES: [usize; 7] = [1, 2, 4, 8, 16, 32, 64];
/// Those that are drawn.
const DRAWN: [usize; 4] = [1, 4, 16, 64];
/// How many of those that are laid out wide take part, both BVHs, and where in the list: before the library's tree.
const WIDE: usize = 2;
const WIDE_AT: usize = 6;
/// What is added to the square of the reference where an error is divided by it.
const FLOOR: f64 = 0.01;
/// Peers less than this ahead are taken for equal: timing is no better.
const MARGIN: f64 = 1.03;

/// A structure that renders.
struct Renderer {
    name: String,
    peer: Peer,
    /// How many time slices, if it is approximate.
    slices: Option<usize>,
    ours: bool,
    style: Style,
    /// Seconds of the build.
    build: f64,
    /// Sums over samples so far.
    sums: Vec<f64>,
    /// Seconds and error after each doubling of samples.
    curve: Vec<(f64, f64)>,
    /// Relative mean squared errors of short runs, each times its seconds.
    short: Vec<f64>,
}

/// A picture to be rendered.
struct Job<'a> {
    scene: &'a Scene,
    shading: Shading<'a>,
    side: usize,
    reference: Vec<f64>,
}

/// Makes the section.
pub fn run(run: &Run) -> Result<Section, Box<dyn Error>> {
    let scenes = ["hall", "hairball", "hand", "tornado"];
    run.begin("render-error", 3 * scenes.len());
    let mut items = vec![Item::Text(
        "A small picture is rendered with a growing number of samples per pixel, each at a random position in the \
         pixel and a random time of the shutter. Plotted is the relative mean squared error (squared difference from a \
         reference, divided by the squared reference plus 0.01, averaged over pixels) against time. All exact \
         structures produce the same error from the same samples and differ only in time. Time slices show the scene \
         at T times only: they trace rays through a static scene, and their error stops falling at their bias. Until \
         then they may well be ahead, since rays in a static scene cost less; more slices cost more build time and \
         memory. Everything renders on one thread, interleaved, with the same shading; builds are listed apart, in the \
         table. Lines without marks are the BVHs of the same colour with sixteen-wide nodes."
            .into(),
    )];
    let mut rows = Vec::new();
    for name in scenes {
        items.extend(one_scene(run, name, &mut rows)?);
    }
    items.push(Item::Table(Table {
        name: "figures".into(),
        caption: "Seconds to a relative variance of 1 (time multiplied by error, which does not depend on the number \
                  of samples while noise dominates); the same over many short runs of 2 samples per pixel (median and \
                  range); the error after all samples; the bias that remains without noise; and the build on one \
                  thread."
            .into(),
        columns: [
            "scene",
            "structure",
            "s to variance 1",
            "short runs: median",
            "least",
            "most",
            "final error",
            "bias",
            "build, s",
        ]
        .map(String::from)
        .to_vec(),
        rows,
    }));
    Ok(Section { id: "render-error", title: "3. Rendering error against time", items })
}

/// All structures over one scene.
fn one_scene(run: &Run, name: &'static str, rows: &mut Vec<Vec<String>>) -> Result<Vec<Item>, Box<dyn Error>> {
    run.step(&format!("{name}: reference"));
    let scene = scene(name, run.pick(4_000, 40_000))?;
    let (side, doublings, short) = run.pick((32, 6, 6), (64, 7, 16));
    let shading = Shading::new(&scene.meshes);
    let mut job = Job { scene: &scene, shading, side, reference: Vec::new() };
    let samples = run.pick(8, 32) << doublings;
    job.reference = reference(&job, samples, run.seed ^ 0x5eed)?;
    run.step(&format!("{name}: builds"));
    let mut renderers = on_one_thread(|| renderers(&job))?;
    run.step(&format!("{name}: samples"));
    let seed = run.seed;
    on_one_thread(|| {
        // An untimed pass, so that none is the first.
        render_all(&mut renderers, &job, 0..1, seed, |_, _| {});
        renderers.iter_mut().for_each(|renderer| renderer.sums.fill(0.0));
        let mut done = 0;
        for doubling in 0..=doublings {
            let next = 1usize << doubling;
            render_all(&mut renderers, &job, done..next, seed, |renderer, seconds| {
                let before = renderer.curve.last().map_or(0.0, |point| point.0);
                renderer.curve.push((before + seconds, job.error(&renderer.sums, next)));
            });
            done = next;
        }
        let sums: Vec<Vec<f64>> = renderers.iter().map(|renderer| renderer.sums.clone()).collect();
        for round in 0..short {
            renderers.iter_mut().for_each(|renderer| renderer.sums.fill(0.0));
            let seed = seed + 1 + round as u64;
            render_all(&mut renderers, &job, 0..2, seed, |renderer, seconds| {
                let error = job.error(&renderer.sums, 2);
                renderer.short.push(seconds * error);
            });
        }
        renderers.iter_mut().zip(sums).for_each(|(renderer, sums)| renderer.sums = sums);
    });
    Ok(judged(name, &job, &renderers, 1 << doublings, rows))
}

/// The picture with many samples, by the library on all threads.
fn reference(job: &Job<'_>, samples: usize, seed: u64) -> Result<Vec<f64>, Box<dyn Error>> {
    let peer = Peer::build(&Structure::wide(), &job.scene.meshes)?;
    let pixel = |at: usize| {
        let sum: f64 = (0..samples).map(|sample| job.value(&peer, at, sample, seed, None)).sum();
        sum / samples as f64
    };
    Ok((0..job.side * job.side).into_par_iter().map(pixel).collect())
}

/// Builds all structures.
fn renderers(job: &Job<'_>) -> Result<Vec<Renderer>, PeerError> {
    let of_slices =
        |n: usize| Member { name: "", structure: Structure::Slices(n, BuildParams::default()), ours: false };
    let mut members = exact();
    // Before ours: each wide BVH is six places behind the binary one, and so has its colour.
    let ours = members.split_off(WIDE_AT);
    members.extend(laid_out_wide().into_iter().take(WIDE));
    members.extend(ours);
    let members = members.into_iter().map(|m| (m, None)).chain(SLICES.map(|n| (of_slices(n), Some(n))));
    let build = |(member, slices): (Member, Option<usize>)| {
        let (peer, build) = timed(|| Peer::build(&member.structure, &job.scene.meshes));
        Ok(Renderer {
            name: slices.map_or(member.name.to_string(), |n| format!("time slices, T = {n}")),
            peer: peer?,
            slices,
            ours: member.ours,
            style: match member.structure {
                Structure::Slices(..) => Style::Dashed,
                Structure::Collapsed(_) => Style::Line,
                _ => Style::LineAndPoints,
            },
            build,
            sums: vec![0.0; job.side * job.side],
            curve: Vec::new(),
            short: Vec::new(),
        })
    };
    members.map(build).collect()
}

/// Renders the same samples with every structure, interleaved; `done` is told how long each took.
fn render_all(
    renderers: &mut [Renderer],
    job: &Job<'_>,
    samples: std::ops::Range<usize>,
    seed: u64,
    mut done: impl FnMut(&mut Renderer, f64),
) {
    for renderer in renderers {
        let Renderer { peer, slices, sums, .. } = renderer;
        let ((), time) = timed(|| {
            for sample in samples.clone() {
                for (at, sum) in sums.iter_mut().enumerate() {
                    *sum += job.value(peer, at, sample, seed, *slices);
                }
            }
        });
        done(renderer, time);
    }
}

impl Job<'_> {
    /// What one sample of a pixel sees.
    #[inline]
    fn value(&self, peer: &Peer, at: usize, sample: usize, seed: u64, slices: Option<usize>) -> f64 {
        let mut random = Random(seed.wrapping_mul(0x9e37_79b9).wrapping_add(((at as u64) << 24) ^ sample as u64));
        let mut unit = || random.unit_f64() as f32;
        let side = self.side;
        let (x, y) = ((at % side) as f32 + unit(), (at / side) as f32 + unit());
        let ray = self.scene.camera.ray(x / side as f32, y / side as f32, 1.0, unit());
        let hit: Option<Hit> = peer.closest_hit(&ray);
        // What a time slice shows is lit as it is then.
        let time = slices.map_or(ray.time, |n| ((ray.time * n as f32).floor().min(n as f32 - 1.0) + 0.5) / n as f32);
        f64::from(self.shading.value(&Ray { time, ..ray }, hit))
    }

    /// The relative mean squared error of sums over so many samples.
    fn error(&self, sums: &[f64], samples: usize) -> f64 {
        let of = |(sum, reference): (&f64, &f64)| {
            let value = sum / samples as f64;
            (value - reference) * (value - reference) / (reference * reference + FLOOR)
        };
        sums.iter().zip(&self.reference).map(of).sum::<f64>() / sums.len() as f64
    }
}

/// The error of a curve at a time, between its points on straight lines of the log-log plot; nothing before the first.
fn error_at(curve: &[(f64, f64)], time: f64) -> Option<f64> {
    let after = curve.iter().position(|point| point.0 >= time);
    match after {
        Some(0) => None,
        Some(i) => {
            let ((t0, e0), (t1, e1)) = (curve[i - 1], curve[i]);
            let s = (time / t0).ln() / (t1 / t0).ln();
            Some(e0 * (e1 / e0).powf(s))
        }
        // Noise falls with time.
        None => curve.last().map(|(t, e)| e * t / time),
    }
}

/// The plot of a scene, the rows of the table, and the claims.
fn judged(
    name: &'static str,
    job: &Job<'_>,
    renderers: &[Renderer],
    samples: usize,
    rows: &mut Vec<Vec<String>>,
) -> Vec<Item> {
    let last = |renderer: &Renderer| renderer.curve.last().copied().unwrap_or((f64::NAN, f64::NAN));
    let exact: Vec<&Renderer> = renderers.iter().filter(|renderer| renderer.slices.is_none()).collect();
    let same = exact.iter().all(|renderer| renderer.sums == exact[0].sums);
    let noise = last(exact[0]).1;
    let mut beaten: [Vec<String>; 2] = [Vec::new(), Vec::new()];
    let ours = renderers.iter().find(|renderer| renderer.ours);
    for renderer in renderers {
        let (time, error) = last(renderer);
        let short = Times::of(renderer.short.clone());
        let number = |x: f64| format!("{x:.2e}");
        let is_exact = renderer.slices.is_none();
        // Bias and noise add up; where the rest is not clearly above the noise, nothing can be said.
        let bias = error - noise;
        rows.push(vec![
            name.to_string(),
            renderer.name.clone(),
            if is_exact { number(time * error) } else { "–".into() },
            number(short.median),
            number(short.least),
            number(short.most),
            number(error),
            if is_exact {
                "0".into()
            } else if bias > 0.2 * noise {
                number(bias)
            } else {
                "below the noise".into()
            },
            format!("{:.3}", renderer.build),
        ]);
        if renderer.ours {
            continue;
        }
        for (with_build, beaten) in beaten.iter_mut().enumerate() {
            let Some(ours) = ours else { continue };
            let [our_build, build] = [ours.build, renderer.build].map(|seconds| seconds * with_build as f64);
            let ahead = |(t, e): &&(f64, f64)| {
                error_at(&ours.curve, (t + build) * MARGIN - our_build).is_some_and(|our| e * MARGIN < our)
            };
            if let Some((_, to)) = renderer.curve.iter().rfind(ahead) {
                beaten.push(format!("{} down to an error of {to:.1e}", renderer.name));
            }
        }
    }
    let drawn = |renderer: &&Renderer| renderer.slices.is_none_or(|n| DRAWN.contains(&n));
    let series = renderers.iter().filter(drawn).map(|renderer| Series {
        label: renderer.name.clone(),
        points: renderer.curve.clone(),
        style: renderer.style,
        ours: renderer.ours,
    });
    let (triangles, side) = (job.scene.triangles(), job.side);
    let axis = |label: &str| Axis { label: label.into(), log: true };
    let plot = Plot {
        name: name.into(),
        title: format!("{name}: error against render time"),
        caption: format!(
            "{name}, {triangles} triangles, {side} times {side} pixels, 1 to {samples} samples per pixel."
        ),
        x: axis("render time, s"),
        y: axis("relative mean squared error"),
        series: series.collect(),
    };
    let claim = |beaten: &Vec<String>, times: &str| {
        let but = if beaten.is_empty() { String::new() } else { format!(" (but these do: {})", beaten.join("; ")) };
        let text = format!("{name}, {times}: no peer lies below and to the left of the wide tree{but}");
        Item::Claim { text, holds: beaten.is_empty() }
    };
    vec![
        Item::Plot(plot),
        claim(&beaten[0], "render time"),
        claim(&beaten[1], "build and render time"),
        Item::Claim {
            text: format!("{name}: all exact structures render the same picture to the last bit"),
            holds: same,
        },
    ]
}
