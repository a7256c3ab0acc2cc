//! Measures the queries of one scene: our tree is built once, then each Embree configuration is built in turn and
//! answers the same rays in alternation with ours. One Embree tree exists at a time.

use crate::agree::{Agreement, Referee};
use crate::configs;
use crate::ffi::{Embree, EmbreeRay, EmbreeScene, Packet};
use crate::options::{Isa, Mode, Only, Options};
use crate::ours::{self, Ours};
use mbkd::{Counters, Hit, Ray};
use mbkd_evidence::scene_rays::{Kind, Rays, generate};
use mbkd_evidence::triangles::scene_size;
use mbkd_evidence::turns::{Checksum, Side, Turns, in_turns};
use mbkd_scenes::Scene;
use std::cell::RefCell;

/// One ray kind of one scene against one Embree configuration.
pub struct Cell {
    pub scene: String,
    pub kind: Kind,
    pub batch: bool,
    pub isa: Isa,
    pub mode: Mode,
    pub config: String,
    pub rays: usize,
    pub turns: Turns,
}

/// All measurements of queries.
#[derive(Default)]
pub struct Measured {
    pub cells: Vec<Cell>,
    /// Scene, kind, number of rays, and the counters of our queries.
    pub work: Vec<(String, Kind, usize, Counters)>,
    pub agreements: Vec<(String, Kind, Agreement)>,
}

struct Bench<'a> {
    options: &'a Options,
    scene: &'a Scene,
    ours: Option<Ours>,
    rays: Rays,
    measured: &'a mut Measured,
}

/// Measures a scene and adds to `measured`.
pub fn measure(
    options: &Options,
    embree: Option<&Embree>,
    scene: &Scene,
    measured: &mut Measured,
) -> Result<(), String> {
    let meshes = &scene.meshes;
    let ours = if options.only == Some(Only::Embree) { None } else { Some(Ours::build(meshes, &ours::pool(1)?)?) };
    let rays = match (&ours, embree) {
        (Some(ours), _) => generate(meshes, &scene.camera, options.side, |ray| ours.closest_hit(ray)),
        (None, Some(embree)) => {
            let device = embree.device("threads=1")?;
            let theirs = configs::all(meshes, Mode::Robust)[0].scene(&device, meshes, Mode::Robust)?;
            theirs.commit()?;
            generate(meshes, &scene.camera, options.side, |ray| theirs.closest_hit(&ray.into()))
        }
        (None, None) => return Err("nothing to measure: no Embree, and our side is left out".to_string()),
    };
    if let Some(ours) = &ours {
        for &kind in &options.kinds {
            let of_kind = rays.of(kind);
            measured.work.push((scene.name.clone(), kind, of_kind.len(), ours.work(kind, of_kind)));
        }
    }
    let mut bench = Bench { options, scene, ours, rays, measured };
    for &isa in &options.isa {
        if isa == Isa::Avx2 {
            bench.ours = bench.ours.map(Ours::with_avx2).transpose()?;
        }
        match embree {
            Some(embree) => bench.against(embree, isa)?,
            None => bench.queries(isa, Mode::Robust, "none", None),
        }
    }
    Ok(())
}

impl Bench<'_> {
    /// All Embree configurations in all modes.
    fn against(&mut self, embree: &Embree, isa: Isa) -> Result<(), String> {
        for &mode in &self.options.modes {
            for (at, config) in configs::all(&self.scene.meshes, mode).into_iter().enumerate() {
                let name = config.name();
                if !self.options.wants(&name) {
                    continue;
                }
                eprintln!("  {}: {} rays, {isa:?}, {mode:?}, {}", self.scene.name, self.rays.primary.len(), name);
                let device = embree.device(&config.settings(1, (isa == Isa::Avx2).then_some("avx2")))?;
                let theirs = config.scene(&device, &self.scene.meshes, mode)?;
                theirs.commit()?;
                if mode == Mode::Robust && isa == self.options.isa[0] && at == 0 {
                    self.compare(&theirs);
                }
                self.queries(isa, mode, &name, Some(&theirs));
            }
        }
        Ok(())
    }

    /// Every ray kind against one Embree tree, or alone.
    fn queries(&mut self, isa: Isa, mode: Mode, config: &str, theirs: Option<&EmbreeScene<'_>>) {
        let batch = self.options.batch.contains(&self.scene.name);
        for &kind in &self.options.kinds {
            let rays = self.rays.of(kind);
            let native: Vec<EmbreeRay> = rays.iter().map(EmbreeRay::from).collect();
            let their_singles = || single_theirs(theirs.expect("asked only where there is one"), kind, &native);
            let our_singles = || single_ours(self.ours.as_ref().expect("asked only where there is one"), kind, rays);
            let there = theirs.is_some();
            let mut turns = vec![(false, String::from(config), {
                let ours: Side<'_> = if self.ours.is_some() { Some(&our_singles) } else { None };
                let theirs: Side<'_> = if there { Some(&their_singles) } else { None };
                in_turns(self.options.runs, ours, theirs)
            })];
            if batch {
                turns.extend(self.batches(config, kind, theirs, &native));
            }
            let cell = |(batch, config, turns)| Cell {
                scene: self.scene.name.clone(),
                kind,
                batch,
                isa,
                mode,
                config,
                rays: rays.len(),
                turns,
            };
            let cells: Vec<Cell> = turns.into_iter().map(cell).collect();
            self.measured.cells.extend(cells);
        }
    }

    /// Our batch query against the better of Embree's single rays and its packets of sixteen.
    fn batches(
        &self,
        config: &str,
        kind: Kind,
        theirs: Option<&EmbreeScene<'_>>,
        native: &[EmbreeRay],
    ) -> Vec<(bool, String, Turns)> {
        let rays = self.rays.of(kind);
        let answers = RefCell::new(Answers::new(rays.len()));
        let our_batch = || match &self.ours {
            Some(ours) => answers.borrow_mut().ours(ours, kind, rays),
            None => unreachable!("asked only where there is one"),
        };
        let ours: Side<'_> = if self.ours.is_some() { Some(&our_batch) } else { None };
        let packets: Vec<Packet> = rays.chunks(crate::ffi::PACKET).map(Packet::new).collect();
        let Some(theirs) = theirs else {
            return vec![(true, config.to_string(), in_turns(self.options.runs, ours, None))];
        };
        let singles = || single_theirs(theirs, kind, native);
        let packed = || packed_theirs(theirs, kind, &packets);
        vec![
            (true, format!("{config}, single rays"), in_turns(self.options.runs, ours, Some(&singles))),
            (true, format!("{config}, packets of 16"), in_turns(self.options.runs, ours, Some(&packed))),
        ]
    }

    /// Compares the answers to every kind of ray; for occlusion rays the closest hit is computed as well, so that a
    /// difference can be explained.
    fn compare(&mut self, theirs: &EmbreeScene<'_>) {
        let Some(ours) = &self.ours else { return };
        let referee = Referee { meshes: &self.scene.meshes, size: f64::from(scene_size(&self.scene.meshes)) };
        for &kind in &self.options.kinds {
            let answers = self.rays.of(kind).iter().map(|ray| {
                let their_ray = EmbreeRay::from(ray);
                let (a, b) = (ours.closest_hit(ray), theirs.closest_hit(&their_ray));
                if kind == Kind::Ao {
                    assert_eq!(ours.any_hit(ray), a.is_some(), "our any_hit and closest_hit at {ray:?}");
                }
                (*ray, a, b)
            });
            self.measured.agreements.push((self.scene.name.clone(), kind, referee.closest(answers)));
        }
    }
}

fn single_ours(ours: &Ours, kind: Kind, rays: &[Ray]) -> Checksum {
    match kind {
        Kind::Ao => Checksum::of(rays, |sum, ray| sum.any(ours.any_hit(ray))),
        _ => Checksum::of(rays, |sum, ray| sum.closest(ours.closest_hit(ray))),
    }
}

fn single_theirs(theirs: &EmbreeScene<'_>, kind: Kind, rays: &[EmbreeRay]) -> Checksum {
    match kind {
        Kind::Ao => Checksum::of(rays, |sum, ray| sum.any(theirs.any_hit(ray))),
        _ => Checksum::of(rays, |sum, ray| sum.closest(theirs.closest_hit(ray))),
    }
}

fn packed_theirs(theirs: &EmbreeScene<'_>, kind: Kind, packets: &[Packet]) -> Checksum {
    let mut sum = Checksum::default();
    match kind {
        Kind::Ao => packets.iter().for_each(|packet| theirs.any_hit_16(packet, |hit| sum.any(hit))),
        _ => packets.iter().for_each(|packet| theirs.closest_hit_16(packet, |hit| sum.closest(hit))),
    }
    sum
}

/// Buffers for a batch's answers, allocated once.
struct Answers {
    closest: Vec<Option<Hit>>,
    any: Vec<bool>,
}

impl Answers {
    fn new(rays: usize) -> Answers {
        Answers { closest: vec![None; rays], any: vec![false; rays] }
    }

    fn ours(&mut self, ours: &Ours, kind: Kind, rays: &[Ray]) -> Checksum {
        let mut sum = Checksum::default();
        if kind == Kind::Ao {
            ours.any_hits(rays, &mut self.any);
            self.any.iter().for_each(|&hit| sum.any(hit));
        } else {
            ours.closest_hits(rays, &mut self.closest);
            self.closest.iter().for_each(|&hit| sum.closest(hit));
        }
        sum
    }
}
