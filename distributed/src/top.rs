//! The top of all ranks' particles, replicated on every rank: about 64 swept boxes of each.

use crate::curve::Curve;
use crate::exchange::{Exchange, gather};
use crate::particle::Particle;
use crate::swept_box::{Image, Periods, SweptBox, farthest, images, near, shift};

/// Boxes of each rank, or a few more. More fit closer and let fewer particles travel; each costs all ranks 32 bytes.
const BOXES: usize = 64;

/// Swept boxes of each rank.
pub(crate) struct Top {
    /// By rank.
    pub(crate) boxes: Vec<Vec<SweptBox>>,
    /// Around those of each rank.
    pub(crate) hulls: Vec<SweptBox>,
    periods: Periods,
}

/// Particles that lie together, by index, and the box around them.
pub(crate) struct Chunk {
    pub(crate) around: SweptBox,
    pub(crate) members: Vec<u32>,
}

/// Cuts particles into chunks along a Morton curve. Those that have left the periodic box have chunks of their own: their
/// images, which lie with the others, are not where they are.
fn chunks(particles: &[Particle], periods: Periods) -> Vec<Chunk> {
    let hull = SweptBox::around(particles.iter().map(SweptBox::from));
    let curve = Curve::new(&hull, [None; 3]);
    let place = |(i, particle): (u32, &Particle)| (period(particle, periods), curve.place(particle), i);
    let mut order: Vec<(Image, u64, u32)> = (0..).zip(particles).map(place).collect();
    order.sort_unstable();
    let most = particles.len().div_ceil(BOXES).max(1);
    let cut = |members: &[(Image, u64, u32)]| {
        let members: Vec<u32> = members.iter().map(|member| member.2).collect();
        let around = SweptBox::around(members.iter().map(|&i| SweptBox::from(&particles[i as usize])));
        Chunk { around, members }
    };
    order.chunk_by(|a, b| a.0 == b.0).flat_map(|period| period.chunks(most)).map(cut).collect()
}

/// In which period along each axis a particle is in the middle of the step.
fn period(particle: &Particle, periods: Periods) -> Image {
    core::array::from_fn(|axis| {
        let middle = 0.5 * (f64::from(particle.open[axis]) + f64::from(particle.close[axis]));
        periods[axis].map_or(0, |length| (middle / f64::from(length)).floor() as i32)
    })
}

impl Top {
    /// The top of the particles of all ranks, and the chunks of the own ones.
    pub(crate) fn new(exchange: &impl Exchange, particles: &[Particle], periods: Periods) -> (Top, Vec<Chunk>) {
        let chunks = chunks(particles, periods);
        let own: Vec<SweptBox> = chunks.iter().map(|chunk| chunk.around).collect();
        let boxes = gather(exchange, &own);
        let hulls = boxes.iter().map(|boxes| SweptBox::around(boxes.iter().copied())).collect();
        (Top { boxes, hulls, periods }, chunks)
    }

    /// Boxes of a rank that images of `a` may come within `radius` of, with the images.
    pub(crate) fn near<'a>(
        &'a self,
        rank: usize,
        a: &'a SweptBox,
        radius: f64,
    ) -> impl Iterator<Item = (Image, &'a SweptBox)> {
        let hull = images(a, &self.hulls[rank], self.periods, radius).next().is_some();
        let boxes = if hull { &self.boxes[rank][..] } else { &[] };
        boxes.iter().flat_map(move |b| images(a, b, self.periods, radius).map(move |image| (image, b)))
    }

    /// For each rank, the own particles that may come within `radius` of one of its.
    pub(crate) fn halo(&self, own: usize, chunks: &[Chunk], particles: &[Particle], radius: f64) -> Vec<Vec<u32>> {
        let wanted = |rank: usize| {
            let mut wanted = Vec::new();
            for chunk in chunks.iter().filter(|_| rank != own) {
                let near_chunk: Vec<_> = self.near(rank, &chunk.around, radius).collect();
                let comes_near = |&i: &u32| {
                    let swept = SweptBox::from(&particles[i as usize]);
                    near_chunk.iter().any(|(image, b)| near(&swept, b, shift(*image, self.periods), radius))
                };
                wanted.extend(chunk.members.iter().copied().filter(comes_near));
            }
            wanted
        };
        (0..self.boxes.len()).map(wanted).collect()
    }

    /// A distance within which there are at least `count` particles of every place in `a`; infinite where there are
    /// fewer in all.
    pub(crate) fn enough(&self, a: &SweptBox, count: u64) -> f64 {
        let mut boxes: Vec<(f64, u64)> =
            self.boxes.iter().flatten().map(|b| (farthest(a, b, self.periods), b.count)).collect();
        boxes.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let mut so_far = 0;
        let enough = boxes.iter().find(|(_, more)| {
            so_far += more;
            so_far >= count
        });
        enough.map_or(f64::INFINITY, |(distance, _)| *distance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Threads;
    use mbkd_scenes::Random;

    /// A row of particles, cut between ranks.
    fn row(ranks: usize, rank: usize) -> Vec<Particle> {
        let all = (0..1000u64).map(|i| Particle::fixed(i, [i as f32, 0.0, 0.0]));
        all.filter(|p| p.id as usize * ranks / 1000 == rank).collect()
    }

    /// Which ids each of three ranks sends to each.
    fn sent(radius: f64, periods: Periods) -> Vec<Vec<Vec<u64>>> {
        Threads::run(3, |ranks| {
            let own = row(3, ranks.rank());
            let (top, chunks) = Top::new(ranks, &own, periods);
            let halo = top.halo(ranks.rank(), &chunks, &own, radius);
            halo.iter().map(|to| to.iter().map(|&i| own[i as usize].id).collect()).collect()
        })
    }

    #[test]
    fn neighbours_get_what_is_within_the_radius_and_no_more() {
        let open = sent(2.0, [None; 3]);
        assert_eq!(open[0], [vec![], vec![332, 333], vec![]], "rank 1 begins at 334");
        assert_eq!(open[1], [vec![334, 335], vec![], vec![665, 666]]);
        let torus = sent(2.0, [Some(1000.0), None, None]);
        assert_eq!(torus[0], [vec![], vec![332, 333], vec![0, 1]]);
        assert_eq!(torus[2][0], [998, 999]);
    }

    #[test]
    fn what_moves_goes_where_it_comes_near() {
        let sent = Threads::run(2, |ranks| {
            let x = ranks.rank() as f32 * 10.0;
            let still = Particle::fixed(1, [x, 0.0, 0.0]);
            let passing = Particle { id: 2, open: [x, 5.0, 0.0], close: [5.0, 0.0, 0.0] };
            let (top, chunks) = Top::new(ranks, &[still, passing], [None; 3]);
            top.halo(ranks.rank(), &chunks, &[still, passing], 1.0)
        });
        assert_eq!(sent[0], [vec![], vec![1]]);
        assert_eq!(sent[1], [vec![1], vec![]]);
    }

    /// Of the pairs of particles on different ranks that come within the radius, how many there are, and how many of them
    /// some rank lacks if halos are made for particles as `seen` sees them.
    fn pairs_lost(periods: Periods, seen: fn(&Particle) -> Particle) -> (usize, usize) {
        const RANKS: usize = 3;
        const RADIUS: f32 = 0.1;
        let mut random = Random(9);
        let sets: [Vec<Particle>; RANKS] = core::array::from_fn(|rank| {
            let particle = |id| {
                let open = [(rank as f32 + random.unit()) / RANKS as f32, random.unit(), random.unit()];
                Particle { id, open, close: open.map(|x| x + 0.3 * (random.unit() - 0.5)) }
            };
            (0..250).map(particle).collect()
        });
        let sent = Threads::run(RANKS, |ranks| {
            let own: Vec<Particle> = sets[ranks.rank()].iter().map(seen).collect();
            let (top, chunks) = Top::new(ranks, &own, periods);
            top.halo(ranks.rank(), &chunks, &own, RADIUS.into())
        });
        let distance = |a: &Particle, b: &Particle, time: f32| {
            let apart = |axis: usize| {
                let at = |p: &Particle| p.open[axis] + (p.close[axis] - p.open[axis]) * time;
                let apart = at(a) - at(b);
                periods[axis].map_or(apart, |length| apart - length * (apart / length).round())
            };
            (0..3).map(|axis| apart(axis) * apart(axis)).sum::<f32>().sqrt()
        };
        let (mut pairs, mut lost) = (0, 0);
        for (from, to) in (0..RANKS).flat_map(|from| (0..RANKS).map(move |to| (from, to))).filter(|(a, b)| a != b) {
            for (i, a) in sets[from].iter().enumerate() {
                let meets = |b: &Particle| (0..=10).any(|step| distance(a, b, 0.1 * step as f32) <= RADIUS);
                let met = sets[to].iter().filter(|b| meets(b)).count();
                pairs += met;
                lost += if sent[from][to].contains(&(i as u32)) { 0 } else { met };
            }
        }
        (pairs, lost)
    }

    #[test]
    fn the_margin_for_motion_is_enough_and_needed() {
        for periods in [[None; 3], [Some(1.0); 3]] {
            let (pairs, lost) = pairs_lost(periods, |particle| *particle);
            assert!(pairs > 500 && lost == 0, "{lost} of {pairs} are lost");
            // Without it: each is seen where the step begins, or ends, only.
            let (_, lost) = pairs_lost(periods, |p| Particle::fixed(p.id, p.open));
            assert!(lost > 10, "of what comes near later, only {lost} are lost");
            let (_, lost) = pairs_lost(periods, |p| Particle::fixed(p.id, p.close));
            assert!(lost > 5, "of what was near before, only {lost} are lost");
        }
    }

    #[test]
    fn what_has_left_the_box_does_not_draw_everything_along() {
        let sent = Threads::run(2, |ranks| {
            let mut own = row(2, ranks.rank());
            if ranks.rank() == 0 {
                own[0].open[0] = 1000.5;
                own[0].close[0] = 1000.5;
            }
            let (top, chunks) = Top::new(ranks, &own, [Some(1000.0), None, None]);
            let halo = top.halo(ranks.rank(), &chunks, &own, 2.0);
            halo[1 - ranks.rank()].iter().map(|&i| own[i as usize].id).collect::<Vec<_>>()
        });
        assert_eq!(sent, [vec![1, 498, 499, 0], vec![500, 501, 999]]);
    }

    #[test]
    fn a_rank_without_particles_neither_sends_nor_gets() {
        let sent = Threads::run(3, |ranks| {
            let own = if ranks.rank() == 1 { vec![] } else { row(3, 0) };
            let (top, chunks) = Top::new(ranks, &own, [Some(1e4), None, None]);
            top.halo(ranks.rank(), &chunks, &own, f64::INFINITY).iter().map(Vec::len).collect::<Vec<_>>()
        });
        assert_eq!(sent, [vec![0, 0, 334], vec![0; 3], vec![334, 0, 0]]);
    }

    #[test]
    fn there_are_enough_within_the_distance() {
        let distances = Threads::run(2, |ranks| {
            let (top, _) = Top::new(ranks, &row(2, ranks.rank()), [None; 3]);
            [1, 500, 1000, 1001].map(|count| top.enough(&SweptBox::of_place([0.0; 3]), count))
        });
        let [one, half, all, more] = distances[0];
        assert!(one < 8.0 && (499.0..507.0).contains(&half) && (999.0..999.1).contains(&all), "{distances:?}");
        assert_eq!(more, f64::INFINITY);
    }
}
