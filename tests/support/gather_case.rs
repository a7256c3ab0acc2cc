//! Gathers by comparing all photons.

use mbkd::glam::Vec3;
use mbkd::point::{GatherQuery, Gathered, Kernel, Photon, PhotonTime};

/// A query with public fields.
#[derive(Clone, Copy, Debug)]
pub struct GatherCase {
    pub at: Vec3,
    pub normal: Vec3,
    pub time: f32,
    pub k: Option<usize>,
    pub radius: f32,
    pub window: f32,
    pub cosine: Option<f32>,
    pub thickness: Option<f32>,
    pub kernels: [Kernel; 2],
    pub odd_only: bool,
    pub in_volume: bool,
}

fn odd(id: u32) -> bool {
    id % 2 == 1
}

impl GatherCase {
    pub fn query(&self) -> GatherQuery<'static> {
        let mut query = GatherQuery::new(self.at, self.normal, self.time).radius(self.radius).window(self.window);
        query = query.kernels(self.kernels[0], self.kernels[1]);
        if let Some(k) = self.k {
            query = query.nearest(k);
        }
        if let Some(cosine) = self.cosine {
            query = query.cosine(cosine);
        }
        if let Some(thickness) = self.thickness {
            query = query.thickness(thickness);
        }
        if self.in_volume {
            query = query.in_volume();
        }
        if self.odd_only { query.filter(&odd) } else { query }
    }

    /// The weight of the photons in a disc of this radius, or a ball.
    pub fn per_extent(&self, radius: f32) -> f32 {
        let [space, _] = self.kernels;
        let extent = if self.in_volume { space.over_ball(radius.into()) } else { space.over_disc(radius.into()) };
        (1.0 / extent) as f32
    }

    /// The answer by comparing all photons, and the photons with their weights.
    pub fn brute(&self, photons: &[Photon<f32>]) -> (Gathered<f32>, Vec<(u32, f32)>) {
        let mut near = Vec::new();
        for (id, photon) in (0..).zip(photons) {
            let (seen, at) = match photon.time {
                PhotonTime::At(stamp) => ((stamp - self.time).abs() <= self.window, photon.position),
                PhotonTime::During(active) => (active.contains(self.time), photon.position),
                PhotonTime::Carried { time, velocity } => {
                    let open = photon.position - velocity * time;
                    let close = photon.position + velocity * (1.0 - time);
                    let (along, t) = (close - open, self.time);
                    let at = if t < 0.5 { open + along * t } else { close + along * (t - 1.0) };
                    ((time - self.time).abs() <= self.window, at)
                }
            };
            let d = at - self.at;
            let passes = self.cosine.is_none_or(|least| photon.normal.dot(self.normal) >= least)
                && self.thickness.is_none_or(|most| d.dot(self.normal).abs() <= most)
                && (!self.odd_only || odd(id));
            let squared = (d.x * d.x + d.y * d.y) + d.z * d.z;
            if seen && passes && squared <= (self.radius * self.radius).min(f32::MAX) {
                near.push((squared, id));
            }
        }
        near.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let k = self.k.unwrap_or(usize::MAX);
        let rim = if near.len() > k {
            Some(near[k].0)
        } else if self.radius == f32::INFINITY {
            near.pop().map(|last| last.0)
        } else {
            None
        };
        near.truncate(k);
        let (radius, squared) = match rim {
            Some(squared) => (squared.sqrt(), squared),
            None => (self.radius, (self.radius * self.radius).min(f32::MAX)),
        };
        let [space, clock] = self.kernels;
        let duration = clock.over_time(self.time.into(), self.window.into(), 0.0, 1.0) as f32;
        let per_extent = self.per_extent(radius);
        let weigh = |&(distance, id): &(f32, u32)| {
            let in_time = match photons[id as usize].time {
                PhotonTime::At(time) | PhotonTime::Carried { time, .. } => {
                    let x = (time - self.time) / self.window;
                    clock.weight(x * x) * (1.0 / duration)
                }
                PhotonTime::During(active) => 1.0 / active.duration(),
            };
            (id, space.weight(distance / squared) * in_time * per_extent)
        };
        let weights: Vec<_> = near.iter().map(weigh).collect();
        let density = weights.iter().fold(0.0, |sum, &(id, weight)| sum + photons[id as usize].flux * weight);
        let reached = self.k.is_some_and(|k| near.len() >= k);
        (Gathered { density, radius, window: self.window, duration, count: near.len(), reached }, weights)
    }
}
