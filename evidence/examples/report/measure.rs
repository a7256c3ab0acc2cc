//! Times and counts of several structures over one scene.

use crate::cast::{Member, run};
use crate::page::Item;
use mbkd::{Counters, Ray, TriangleMesh};
use mbkd_evidence::peers::{Peer, PeerError, PeerStatistics};
use mbkd_evidence::timing::{Times, race, seconds};
use std::cell::RefCell;

/// What was measured of one structure over one scene.
pub struct Figures {
    /// Seconds of the build.
    pub build: Times,
    /// Camera rays and bounce rays, seconds per ray.
    pub rays: [Times; 2],
    /// Inner nodes, steps (these and leaves) and tests per ray of both kinds.
    pub nodes: [f64; 2],
    pub steps: [f64; 2],
    pub tests: [f64; 2],
    /// Figures of the structure itself.
    pub of: PeerStatistics,
}

impl Figures {
    /// Seconds of a camera ray and of a bounce ray.
    pub fn times(&self) -> [f64; 2] {
        self.rays.map(|times| times.median)
    }
}

/// The times of whichever structure is the fastest, of each kind of rays.
pub fn fastest(of: &[Figures]) -> [f64; 2] {
    of.iter().map(Figures::times).fold([f64::INFINITY; 2], |[a, b], [c, d]| [a.min(c), b.min(d)])
}

/// The statement that one takes less time for its rays than another in every scene: the scene's name, and the times of
/// both.
pub fn faster(text: &str, scenes: &[(&str, [f64; 2], [f64; 2])]) -> Item {
    let per_cent = |kind: usize| -> Vec<f64> { scenes.iter().map(|(_, of, to)| 100.0 * of[kind] / to[kind]).collect() };
    let listed = |ratios: &[f64]| {
        let each = scenes.iter().zip(ratios).map(|((name, ..), ratio)| format!("{name} {ratio:.0}"));
        each.collect::<Vec<_>>().join(", ")
    };
    let (camera, bounce) = (per_cent(0), per_cent(1));
    Item::Claim {
        text: format!("{text} (camera rays: {}; bounce rays: {})", listed(&camera), listed(&bounce)),
        holds: camera.iter().chain(&bounce).all(|ratio| *ratio < 100.0),
    }
}

/// Builds and queries all structures, interleaved.
pub fn measure(
    cast: &[Member],
    meshes: &[TriangleMesh],
    rays: [&[Ray]; 2],
    [builds, rounds]: [usize; 2],
) -> Result<Vec<Figures>, PeerError> {
    let slots: Vec<RefCell<Option<Result<Peer, PeerError>>>> = cast.iter().map(|_| RefCell::new(None)).collect();
    let mut tasks: Vec<Box<dyn FnMut() + '_>> = Vec::new();
    for (member, slot) in cast.iter().zip(&slots) {
        tasks.push(Box::new(move || {
            *slot.borrow_mut() = Some(Peer::build(&member.structure, meshes));
        }));
    }
    let built = race(seconds, builds, &mut tasks);
    drop(tasks);
    let peers: Vec<Peer> = slots.into_iter().filter_map(RefCell::into_inner).collect::<Result<_, _>>()?;
    let of_kind = |rays: &[Ray]| {
        let mut tasks: Vec<Box<dyn FnMut() + '_>> = Vec::new();
        for peer in &peers {
            tasks.push(Box::new(move || run(peer, rays)));
        }
        race(seconds, if rays.is_empty() { 1 } else { rounds }, &mut tasks)
    };
    let times = rays.map(of_kind);
    let figures = peers.iter().enumerate().map(|(i, peer)| {
        let counters = rays.map(|rays| {
            let mut counters = Counters::default();
            for ray in rays {
                peer.closest_hit_observed(ray, &mut counters);
            }
            counters
        });
        let per_ray = |of: fn(&Counters) -> u64| [0, 1].map(|k| of(&counters[k]) as f64 / rays[k].len() as f64);
        let scaled = |k: usize| {
            let n = rays[k].len() as f64;
            let Times { median, least, most } = times[k][i];
            Times { median: median / n, least: least / n, most: most / n }
        };
        Figures {
            build: built[i],
            rays: [scaled(0), scaled(1)],
            nodes: per_ray(|c| c.nodes),
            steps: per_ray(|c| c.steps()),
            tests: per_ray(|c| c.primitive_tests),
            of: peer.statistics(),
        }
    });
    Ok(figures.collect())
}
