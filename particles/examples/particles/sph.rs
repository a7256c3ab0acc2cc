//! A weakly compressible fluid by smoothed particle hydrodynamics.
//!
//! Densities are sums over neighbours, pressures follow Tait's equation with a speed of sound ten times that of a wave
//! (J. J. Monaghan, "Simulating free surface flows with SPH", 1994), pressure forces are symmetric and viscosity is
//! artificial, so forces between fluid particles are equal and opposite. Walls are static particles that push back with
//! the pressure of the fluid (N. Akinci et al., "Versatile rigid-fluid coupling for incompressible SPH", 2012). Time
//! steps are symplectic and limited by the speed of sound and by forces.

use crate::kernel::Kernel;
use crate::tank::Brick;
use mbkd::glam::{DVec3, Vec3};
use mbkd::{NeighborLists, PointParams, PointTree};
use mbkd_renderer::fluid::Tank;
use rayon::prelude::*;
use std::error::Error;
use std::time::{Duration, Instant};

pub const GRAVITY: Vec3 = Vec3::new(0.0, -9.81, 0.0);
/// Density of water at rest, kg/m³.
const REST: f32 = 1000.0;
/// Radius of the kernel in spacings: about forty neighbours.
const REACH: f32 = 2.2;
/// Factor of the artificial viscosity.
const VISCOSITY: f32 = 0.06;
/// Steps between reorderings of the particles into tree order, in which neighbours are close in memory.
const REORDER: usize = 8;

/// The fluid and its walls.
pub struct Fluid {
    pub at: Vec<Vec3>,
    pub velocity: Vec<Vec3>,
    pub density: Vec<f32>,
    pub spacing: f32,
    pub time: f64,
    pub steps: usize,
    pub kernel: Kernel,
    /// The mass of each particle.
    pub mass: f32,
    /// How often a particle was found outside the tank and put back.
    pub put_back: usize,
    /// Time spent on neighbour lists.
    pub neighbors: Duration,
    /// Neighbours in all lists of the last step.
    pub listed: usize,
    sound: f32,
    /// Pressure over squared density.
    push: Vec<f32>,
    /// The particles as they were when the step began.
    tree: PointTree,
    walls: PointTree,
    wall_at: Vec<Vec3>,
    /// For each wall particle its mass: that of a fluid particle, scaled by its volume.
    wall_mass: Vec<f32>,
    tank: Tank,
    /// The momentum added by gravity and walls since the beginning.
    impulse: DVec3,
    begin: DVec3,
    lists: NeighborLists,
    wall_lists: NeighborLists,
}

/// Sums over all particles.
pub struct Sums {
    pub mass: f64,
    pub momentum: DVec3,
    /// Momentum that is neither from the start nor from gravity and walls.
    pub unexplained: DVec3,
    pub kinetic: f64,
    pub potential: f64,
    /// Energy of compression.
    pub elastic: f64,
    pub fastest: f32,
}

impl Fluid {
    pub fn new(
        at: Vec<Vec3>,
        velocity: Vec<Vec3>,
        spacing: f32,
        tank: Tank,
        bricks: &[Brick],
    ) -> Result<Fluid, Box<dyn Error>> {
        let kernel = Kernel::new(REACH * spacing);
        let wall_at: Vec<Vec3> = bricks.iter().map(|brick| brick.0).collect();
        let walls = PointTree::build(&wall_at, &PointParams::default())?;
        let crowd = |lists: &NeighborLists, row: usize| {
            let range = lists.range(row);
            let squares = &lists.distances_squared()[range];
            kernel.value(0.0) + squares.iter().map(|&square| kernel.value(square)).sum::<f32>()
        };
        // The mass that gives rest density to the particle at the 90th percentile of kernel sums.
        let mut lists = NeighborLists::new();
        let tree = PointTree::build(&at, &PointParams::default())?;
        tree.neighbor_lists(0.0, kernel.radius).with_distances().run(&mut lists)?;
        let mut crowds: Vec<f32> = (0..lists.len()).map(|row| crowd(&lists, row)).collect();
        crowds.sort_by(f32::total_cmp);
        let mass = REST / crowds.get(crowds.len() * 9 / 10).ok_or("no particles")?;
        let wall_mass = bricks.iter().map(|brick| mass * brick.1).collect();
        let (low, high) = at.iter().fold((f32::INFINITY, f32::NEG_INFINITY), |(l, h), p| (l.min(p.y), h.max(p.y)));
        let fastest = velocity.iter().map(|v| v.length()).fold(0.0, f32::max);
        let sound = 10.0 * (-GRAVITY.y * (high - low + spacing)).sqrt().max(0.5 * fastest);
        let count = at.len();
        let mut fluid = Fluid {
            at,
            velocity,
            density: vec![REST; count],
            spacing,
            time: 0.0,
            steps: 0,
            kernel,
            mass,
            put_back: 0,
            neighbors: Duration::ZERO,
            listed: 0,
            sound,
            push: vec![0.0; count],
            tree,
            walls,
            wall_at,
            wall_mass,
            tank,
            impulse: DVec3::ZERO,
            begin: DVec3::ZERO,
            lists,
            wall_lists: NeighborLists::new(),
        };
        fluid.begin = fluid.sums().momentum;
        Ok(fluid)
    }

    /// The approximate number of steps for a time.
    pub fn steps_for(&self, seconds: f64) -> usize {
        (seconds / f64::from(0.4 * 0.5 * self.kernel.radius / (1.12 * self.sound))).ceil() as usize
    }

    /// One step, at most `most` seconds long.
    pub fn step(&mut self, most: f64) -> Result<(), Box<dyn Error>> {
        let begin = Instant::now();
        self.tree.rebuild(&self.at, &PointParams::default())?;
        self.tree.neighbor_lists(0.0, self.kernel.radius).run(&mut self.lists)?;
        self.tree.neighbor_lists(0.0, self.kernel.radius).among(&self.walls).run(&mut self.wall_lists)?;
        self.neighbors += begin.elapsed();
        self.listed = self.lists.neighbors();
        self.densities();
        let forces = self.accelerations();

        let half = 0.5 * self.kernel.radius;
        let fastest = self.velocity.par_iter().map(|v| v.length_squared()).reduce(|| 0.0, f32::max).sqrt();
        let hardest = forces.par_iter().map(|f| (f.fluid + f.walls).length_squared()).reduce(|| 0.0, f32::max).sqrt();
        let by_sound = 0.4 * half / (self.sound + fastest);
        let by_force = 0.25 * (half / hardest.max(1e-6)).sqrt();
        let dt = f64::from(by_sound.min(by_force)).min(most);
        self.advance(&forces, dt as f32);
        self.time += dt;
        self.steps += 1;
        if self.steps % REORDER == 1 {
            self.reorder();
        }
        Ok(())
    }

    /// Sums densities over neighbours and computes pressures from them.
    fn densities(&mut self) {
        let own = self.kernel.value(0.0);
        let stiffness = self.sound * self.sound / (7.0 * REST);
        let density = |row: usize| {
            let at = self.at[self.lists.points()[row] as usize];
            let of = |other: Vec3| self.kernel.value((at - other).length_squared());
            let fluid: f32 = self.lists.row(row).iter().map(|&j| of(self.at[j as usize])).sum();
            let walls = self.wall_lists.row(row).iter();
            let walls: f32 = walls.map(|&b| self.wall_mass[b as usize] * of(self.wall_at[b as usize])).sum();
            let density = self.mass * (own + fluid) + walls;
            let compression = (density / REST).powi(7) - 1.0;
            // Pressure only pushes: particles at the surface, which lack neighbours, do not pull.
            (density, stiffness * REST * REST * compression.max(0.0) / (density * density))
        };
        let rows: Vec<(f32, f32)> = (0..self.lists.len()).into_par_iter().map(density).collect();
        for (&id, (density, push)) in self.lists.points().iter().zip(rows) {
            self.density[id as usize] = density;
            self.push[id as usize] = push;
        }
    }

    /// Accelerations, in the order of the lists.
    fn accelerations(&self) -> Vec<Forces> {
        let half = 0.5 * self.kernel.radius;
        let least = 0.01 * half * half;
        let viscous = VISCOSITY * half * self.sound;
        let of_row = |row: usize| {
            let i = self.lists.points()[row] as usize;
            let (at, velocity, density, push) = (self.at[i], self.velocity[i], self.density[i], self.push[i]);
            // Positive only for particles that approach each other.
            let damping = |way: Vec3, square: f32, speed: Vec3, density: f32| {
                viscous * (-way.dot(speed)).max(0.0) / ((square + least) * density)
            };
            let mut fluid = Vec3::ZERO;
            for &j in self.lists.row(row) {
                let j = j as usize;
                let way = at - self.at[j];
                let square = way.length_squared();
                let mean = 0.5 * (density + self.density[j]);
                let damping = damping(way, square, velocity - self.velocity[j], mean);
                fluid -= self.kernel.gradient(way, square) * (push + self.push[j] + damping);
            }
            let mut walls = Vec3::ZERO;
            for &b in self.wall_lists.row(row) {
                let b = b as usize;
                let way = at - self.wall_at[b];
                let square = way.length_squared();
                let damping = damping(way, square, velocity, density);
                walls -= self.kernel.gradient(way, square) * (self.wall_mass[b] * (2.0 * push + damping));
            }
            Forces { fluid: fluid * self.mass, walls }
        };
        (0..self.lists.len()).into_par_iter().map(of_row).collect()
    }

    fn advance(&mut self, forces: &[Forces], dt: f32) {
        let [low, high] = self.tank.inside;
        let (mut added, mut put_back) = (DVec3::ZERO, 0);
        for (&id, force) in self.lists.points().iter().zip(forces) {
            let i = id as usize;
            let outside = (force.walls + GRAVITY) * dt;
            added += outside.as_dvec3();
            let velocity = self.velocity[i] + force.fluid * dt + outside;
            let at = self.at[i] + velocity * dt;
            let inside = Vec3::new(at.x.clamp(low.x, high.x), at.y.max(low.y), at.z.clamp(low.z, high.z));
            self.velocity[i] = velocity;
            if inside != at {
                put_back += 1;
                let stopped = Vec3::select(inside.cmpeq(at), velocity, Vec3::ZERO);
                added += (stopped - velocity).as_dvec3();
                self.velocity[i] = stopped;
            }
            self.at[i] = inside;
        }
        self.impulse += added * f64::from(self.mass);
        self.put_back += put_back;
    }

    /// Reorders particles into the order of the tree.
    fn reorder(&mut self) {
        let order = self.tree.take_order();
        self.at = order.iter().map(|&id| self.at[id as usize]).collect();
        self.velocity = order.iter().map(|&id| self.velocity[id as usize]).collect();
        self.density = order.iter().map(|&id| self.density[id as usize]).collect();
        self.push = order.iter().map(|&id| self.push[id as usize]).collect();
    }

    pub fn sums(&self) -> Sums {
        let mass = f64::from(self.mass);
        let (rest, low) = (f64::from(REST), f64::from(self.tank.inside[0].y));
        let stiffness = f64::from(self.sound).powi(2) * rest / 7.0;
        let mut sums = Sums {
            mass: mass * self.at.len() as f64,
            momentum: DVec3::ZERO,
            unexplained: DVec3::ZERO,
            kinetic: 0.0,
            potential: 0.0,
            elastic: 0.0,
            fastest: 0.0,
        };
        for ((at, velocity), density) in self.at.iter().zip(&self.velocity).zip(&self.density) {
            sums.momentum += velocity.as_dvec3() * mass;
            sums.kinetic += 0.5 * mass * velocity.as_dvec3().length_squared();
            sums.potential += mass * f64::from(-GRAVITY.y) * (f64::from(at.y) - low);
            // The integral of pressure over squared density from rest.
            let r = (f64::from(*density) / rest).max(1.0);
            sums.elastic += mass * stiffness / rest * (r.powi(6) / 6.0 + 1.0 / r - 7.0 / 6.0);
            sums.fastest = sums.fastest.max(velocity.length());
        }
        sums.unexplained = sums.momentum - self.begin - self.impulse;
        sums
    }
}

/// The accelerations of a particle without gravity.
struct Forces {
    fluid: Vec3,
    walls: Vec3,
}
