//! Particles on their way, and ways to keep their neighbour lists up to date: what lists cost, and how many pairs they miss.

use mbkd::glam::Vec3;
use mbkd::{MovingPoint, NeighborLists, PointParams, PointStructure, PointTree};
use mbkd_evidence::point_sets::spacing;
use mbkd_scenes::Random;
use std::error::Error;
use std::time::Instant;

/// Where particles are at each step. Nobody knows the next accelerations, only how large they can be.
pub struct Walk {
    /// Positions at each step.
    pub positions: Vec<Vec<Vec3>>,
    /// The motion from each step to the next, had the particle not been accelerated.
    velocities: Vec<Vec<Vec3>>,
    /// The most that an acceleration changes a velocity in a step.
    most: f32,
    /// Pairs nearer than this count.
    pub radius: f32,
    /// Such pairs at each step, from both sides.
    pub pairs: Vec<usize>,
}

/// A random vector of at most unit length.
fn in_ball(random: &mut Random) -> Vec3 {
    loop {
        let p = random.dvec();
        if p.length_squared() <= 1.0 {
            return p.as_vec3();
        }
    }
}

impl Walk {
    /// `n` particles that fill the unit cube, most of them slow, a few up to ten times as fast, pushed about at random.
    pub fn new(n: usize, steps: usize, seed: u64) -> Result<Walk, Box<dyn Error>> {
        let mut random = Random(seed);
        let spacing = spacing(n);
        let start: Vec<Vec3> = (0..n).map(|_| (random.dvec() * 0.5).as_vec3() + 0.5).collect();
        // In an order in which near particles are near in memory, as particle codes keep them.
        let mut tree = PointTree::build(&start, &PointParams::default())?;
        let mut at: Vec<Vec3> = tree.take_order().iter().map(|&i| start[i as usize]).collect();
        let mut velocity: Vec<Vec3> = (0..n)
            .map(|_| in_ball(&mut random) * (0.03 * spacing / (random.unit_f64() as f32).max(0.01).sqrt()))
            .collect();
        let most = 0.005 * spacing;
        let radius = 2.1 * spacing;
        let mut walk = Walk { positions: Vec::new(), velocities: Vec::new(), most, radius, pairs: Vec::new() };
        let mut lists = NeighborLists::new();
        for _ in 0..steps {
            tree.rebuild(&at, &PointParams::default())?;
            tree.neighbor_lists(0.0, radius).run(&mut lists)?;
            walk.pairs.push(lists.neighbors());
            walk.positions.push(at.clone());
            walk.velocities.push(velocity.clone());
            for (at, velocity) in at.iter_mut().zip(&mut velocity) {
                *velocity += in_ball(&mut random) * most;
                *at += *velocity;
            }
        }
        Ok(walk)
    }

    fn steps(&self) -> usize {
        self.positions.len()
    }
}

/// What makes lists.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Maker {
    /// This library.
    Mbkd,
    /// The crate linkcell, a grid of cells.
    Linkcell,
}

/// When lists are made anew. Skins are in radii.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Upkeep {
    /// At every step, without a skin.
    EveryStep,
    /// When the certificate that came with them ends.
    Certified {
        /// The skin.
        skin: f32,
    },
    /// After a number of steps that somebody guessed.
    Guessed {
        /// The skin.
        skin: f32,
        /// The steps.
        every: usize,
    },
    /// When the two farthest ways since they were made add up to more than the skin, which is looked at in each step.
    Monitored {
        /// The skin.
        skin: f32,
    },
}

/// Lists of either maker.
struct Lists {
    maker: Maker,
    tree: Option<PointTree>,
    lists: NeighborLists,
    wide: Vec<[f64; 3]>,
    columns: linkcell::PairColumns,
}

impl Lists {
    fn new(maker: Maker) -> Lists {
        Lists {
            maker,
            tree: None,
            lists: NeighborLists::new(),
            wide: Vec::new(),
            columns: linkcell::PairColumns::default(),
        }
    }

    /// Makes them of all pairs nearer than `reach`.
    fn make(&mut self, at: &[Vec3], reach: f32) -> Result<(), Box<dyn Error>> {
        if self.maker == Maker::Linkcell {
            self.wide.clear();
            self.wide.extend(at.iter().map(|p| p.as_dvec3().to_array()));
            let size = 1.0 + 2.0 * self.wide.iter().flatten().fold(0.0f64, |most, x| most.max(x.abs()));
            let cell = linkcell::Cell::ortho(size, size, size).map_err(|e| format!("linkcell: {e:?}"))?;
            let columns = &mut self.columns;
            return linkcell::pairs_within_columns(&self.wide, &cell, reach.into(), None, None, false, columns)
                .map_err(|e| format!("linkcell: {e:?}").into());
        }
        let tree = match self.tree.take() {
            Some(mut tree) => {
                tree.rebuild(at, &PointParams::default())?;
                tree
            }
            None => PointTree::build(at, &PointParams::default())?,
        };
        self.tree.insert(tree).neighbor_lists(0.0, reach).run(&mut self.lists)?;
        Ok(())
    }

    /// Listed pairs that are within the radius now: what a loop over forces looks at in each step.
    fn count(&self, at: &[Vec3], radius: f32) -> usize {
        let square = radius * radius;
        let near = |a: Vec3, b: Vec3| usize::from(a.distance_squared(b) <= square);
        if self.maker == Maker::Linkcell {
            let pairs = self.columns.i.iter().zip(&self.columns.j);
            return pairs.map(|(&i, &j)| near(at[i as usize], at[j as usize])).sum();
        }
        let of = |(id, row): (u32, &[u32])| {
            let own = at[id as usize];
            row.iter().map(|&other| near(own, at[other as usize])).sum::<usize>()
        };
        self.lists.iter().map(of).sum()
    }
}

/// What a way to keep lists costs and misses.
#[derive(Clone, Copy, Debug, Default)]
pub struct Kept {
    /// Seconds for all steps.
    pub seconds: f64,
    /// Share of the pairs that were not listed.
    pub missed: f64,
    /// How often lists were made.
    pub made: usize,
}

/// Goes through all steps of a walk.
pub fn keep(walk: &Walk, maker: Maker, upkeep: Upkeep) -> Result<Kept, Box<dyn Error>> {
    let mut lists = Lists::new(maker);
    let (mut good_until, mut ahead, mut made_at, mut made) = (None, 4, 0, 0);
    let mut found = 0;
    let start = Instant::now();
    for step in 0..walk.steps() {
        let at = &walk.positions[step];
        let reach = |skin: f32| walk.radius * (1.0 + skin);
        let expired = good_until.is_none_or(|last| step > last);
        match upkeep {
            Upkeep::EveryStep => {
                lists.make(at, walk.radius)?;
                made += 1;
            }
            Upkeep::Guessed { skin, every } if expired => {
                lists.make(at, reach(skin))?;
                good_until = Some(step + every - 1);
                made += 1;
            }
            Upkeep::Monitored { skin } => {
                let outrun = made == 0 || two_farthest(&walk.positions[made_at], at) > walk.radius * skin;
                if outrun {
                    lists.make(at, reach(skin))?;
                    made_at = step;
                    made += 1;
                }
            }
            Upkeep::Certified { skin } if expired => {
                let good = certified(walk, step, skin, ahead, &mut lists.lists)?;
                good_until = Some(step + good);
                // Looking farther ahead than lists last costs more than it finds out.
                ahead = (2 * good).max(1);
                made += 1;
            }
            Upkeep::Guessed { .. } | Upkeep::Certified { .. } => {}
        }
        found += lists.count(at, walk.radius);
    }
    let seconds = start.elapsed().as_secs_f64();
    let all: usize = walk.pairs.iter().sum();
    // linkcell computes in f64, and may list a pair at the very radius that f32 does not count.
    let missed = all.saturating_sub(found) as f64 / all as f64;
    Ok(Kept { seconds, missed, made })
}

/// Makes lists with a skin, and returns for how many steps after this one they are certain to hold every pair.
///
/// What is known is the velocities, and how large accelerations can be. The lists are certified for motion with these
/// velocities over `ahead` steps and for a radius larger by what accelerations of both points can add by then: a velocity
/// is off by up to `j·a` in the j-th step, so a place by up to `a·L(L + 1)/2` after L.
fn certified(
    walk: &Walk,
    step: usize,
    skin: f32,
    ahead: usize,
    lists: &mut NeighborLists,
) -> Result<usize, Box<dyn Error>> {
    let skin = walk.radius * skin;
    // Positions are rounded in every step.
    let strayed = |steps: usize| walk.most * (steps * (steps + 1)) as f32 + 1e-6 * steps as f32;
    let mut ahead = ahead;
    while ahead > 1 && strayed(ahead) > 0.5 * skin {
        ahead -= 1;
    }
    let ways = walk.positions[step].iter().zip(&walk.velocities[step]);
    let points: Vec<MovingPoint> = ways.map(|(p, v)| MovingPoint::new(*p, *p + *v * ahead as f32)).collect();
    let params = PointParams { structure: PointStructure::Linear, ..PointParams::default() };
    let tree = PointTree::build(&points, &params)?;
    let spare = (skin - strayed(ahead)).max(0.0);
    let until = tree.neighbor_lists_with_skin(0.0, walk.radius + skin - spare, spare, 1.0, lists)?;
    Ok((until * ahead as f32) as usize)
}

/// The two longest ways from one set of positions to another, added.
fn two_farthest(from: &[Vec3], to: &[Vec3]) -> f32 {
    let (mut first, mut second) = (0.0f32, 0.0f32);
    for (a, b) in from.iter().zip(to) {
        let square = a.distance_squared(*b);
        if square > first {
            (first, second) = (square, first);
        } else if square > second {
            second = square;
        }
    }
    first.sqrt() + second.sqrt()
}
