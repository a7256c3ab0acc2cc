//! Ray trees that live on: cloned, refitted in all ways, saved and loaded, and placed in trees of instances. After each step all
//! queries are compared with brute force, and former clones are as they were.

use crate::compare::Outcome;
use crate::instances::{Brute, Leaf, Placed, check as check_placed};
use crate::random::Random;
use crate::rays::{Answers, Queries};
use crate::scenes::{Scene, is_documented, params, wide};
use core::ops::ControlFlow;
use mbkd::baseline::BruteForce;
use mbkd::glam::{DAffine3, DVec3};
use mbkd::{
    Aabb, BuildError, BuildParams, FileError, Instance, InstanceTree, Policy, RayTree, RefitError, SimdLevel, TreeBox,
    TreePrimitive, Visitor,
};
use std::sync::Arc;

/// A scene, the tree over it, and what it has to answer.
struct Life {
    scene: Scene,
    tree: Arc<RayTree>,
    queries: Queries,
    answers: Answers,
}

impl Life {
    fn new(random: &mut Random, scene: Scene, tree: Arc<RayTree>) -> Result<Life, String> {
        let oracle = BruteForce::of_scene(&scene.meshes, scene.shapes()).map_err(|error| error.to_string())?;
        let queries = Queries::new(random, &scene, &oracle, if scene.len() > 1000 { 8 } else { 20 });
        let answers = Answers::of_brute_force(&oracle, &queries);
        Ok(Life { scene, tree, queries, answers })
    }

    fn check(&self, random: &mut Random, what: &str) -> Outcome {
        self.answers.check(&self.tree, &self.queries, what)?;
        bounds(random, &self.scene, &self.tree, what)?;
        visited(random, &self.scene, &self.tree, what)
    }
}

/// What exists lies in the bounds at its time, and in some box of the tree.
fn bounds(random: &mut Random, scene: &Scene, tree: &RayTree, what: &str) -> Outcome {
    let time = random.time();
    let (swept, linear) = (tree.bounds(), tree.linear_bounds());
    same!(swept.is_some(), scene.len() > 0, "{what}: bounds");
    let mut boxes: Vec<TreeBox> = Vec::new();
    if tree.statistics().subtrees == 0 {
        tree.boxes(time, |of| boxes.push(of));
    }
    // Of trees without nodes, bounds are those of the positions as given, and boxes are as wide as those of queries up to a few
    // roundings.
    let slack = swept.map_or(0.0, |of| of.min.abs().max(of.max.abs()).max_element()) * 1e-6;
    for (mesh, triangle) in scene.exist_at(time) {
        let corners = match scene.meshes.get(mesh as usize) {
            Some(_) => tree.triangle(mesh, triangle, time).to_vec(),
            None => vec![scene.balls[triangle as usize].0.at(time).0],
        };
        for corner in corners {
            let holds = |of: &Aabb| of.pad(slack).contains(corner);
            let what = format_args!("{what}: {corner} of {triangle} in {mesh} at {time}");
            ensure!(swept.as_ref().is_some_and(holds), "{what} is outside of {swept:?}");
            ensure!(linear.is_some_and(|of| holds(&of.at(time.into()))), "{what} is outside of {linear:?}");
            ensure!(boxes.is_empty() || boxes.iter().any(|of| holds(&of.bounds)), "{what} is in no box");
        }
    }
    Ok(())
}

/// Enters the boxes that hold a place, and finds a primitive.
struct At {
    place: DVec3,
    name: (u32, u32),
    found: bool,
}

impl Visitor<TreePrimitive> for At {
    fn enter(&mut self, of: &Aabb) -> Option<f32> {
        of.contains(self.place).then_some(0.0)
    }

    fn visit(&mut self, item: TreePrimitive) -> ControlFlow<()> {
        self.found |= (item.mesh, item.primitive) == self.name;
        if self.found { ControlFlow::Break(()) } else { ControlFlow::Continue(()) }
    }
}

/// A visitor finds primitives by the boxes that hold a corner, or the center of a sphere.
fn visited(random: &mut Random, scene: &Scene, tree: &RayTree, what: &str) -> Outcome {
    let time = random.time();
    let all = scene.exist_at(time);
    for _ in 0..20.min(all.len()) {
        let name = all[random.below(all.len())];
        let place = match scene.meshes.get(name.0 as usize) {
            Some(_) => tree.triangle(name.0, name.1, time)[random.below(3)],
            None => scene.balls[name.1 as usize].0.at(time).0,
        };
        let mut visitor = At { place, name, found: false };
        let _ = tree.traverse(time, &mut visitor);
        ensure!(visitor.found, "{what}: {name:?} is not found by {place} at {time}");
    }
    Ok(())
}

pub fn case(random: &mut Random) -> Outcome {
    let most = random.pick(&[3, 30, 200, 1500]);
    let power = random.pick(&[0, 0, 6, 28]);
    let scene = Scene::random(random, most, power);
    let params = params(random);
    let tree = match RayTree::of_scene(&scene.meshes, scene.shapes(), &params) {
        Err(error) if is_documented(&error) => return Ok(()),
        tree => tree.map_err(|error| format!("{params:?}: {error}"))?,
    };
    let mut what = format!("{params:?}");
    let mut life = Life::new(random, scene, Arc::new(tree))?;
    let mut former: Vec<Life> = Vec::new();
    for _ in 0..2 + random.below(4) {
        // What is placed, or held by a former step, is refitted as a copy.
        if random.one_in(2) {
            let held = Life::new(random, life.scene.clone(), life.tree.clone())?;
            former.push(held);
        }
        match random.below(6) {
            0 => {
                let mut bytes = Vec::new();
                match life.tree.write_to(&mut bytes) {
                    Err(FileError::Lazy) => {}
                    result => {
                        result.map_err(|error| format!("{what}: {error}"))?;
                        what += "; file";
                        let read = RayTree::read_with_shapes_from(&mut bytes.as_slice(), life.scene.shapes());
                        life.tree = Arc::new(read.map_err(|error| format!("{what}: {error}"))?);
                    }
                }
            }
            1 => {
                let tree = RayTree::clone(&life.tree).with_simd(random.pick(&SimdLevel::available()));
                what += "; clone";
                life.tree = Arc::new(tree);
            }
            2 => placed(random, &life, &what)?,
            _ => {
                let (scene, way) = refit(random, &life.scene, Arc::make_mut(&mut life.tree), &params, &what)?;
                what += &way;
                life = Life::new(random, scene, life.tree)?;
            }
        }
        life.check(random, &what)?;
        same!(life.tree.validate(), Ok(()), "{what}");
        same!(life.tree.statistics().primitives, life.scene.len(), "{what}: primitives");
        for held in &former {
            held.check(random, &format!("{what}: a former clone"))?;
        }
    }
    Ok(())
}

/// Refits a tree to another frame; returns the scene of the tree, the same one if it was refused.
fn refit(
    random: &mut Random,
    scene: &Scene,
    tree: &mut RayTree,
    params: &BuildParams,
    what: &str,
) -> Result<(Scene, String), String> {
    let (mut next, differ) = scene.moved(random);
    let way = random.below(4);
    if way > 1 {
        next = next.with_other_balls(random);
    }
    let result = match way {
        0 => tree.refit(&next.meshes),
        1 => tree.refit_moved(&next.meshes, &differ),
        2 => tree.refit_with_shapes(&next.meshes, next.shapes()),
        _ => tree.refit_moved_with_shapes(&next.meshes, &differ, next.shapes()),
    };
    let way = format!("; {} {differ:?}", ["refit", "refit_moved", "with_shapes", "moved_with_shapes"][way]);
    match result {
        Ok(refit) => {
            ensure!(refit.cost.is_finite() && refit.cost >= 0.0, "{what}{way}: {refit:?}");
            Ok((next, format!("{way} {refit:?}")))
        }
        Err(RefitError::Policy | RefitError::Lazy) if !matches!(params.policy, Policy::Wide(_)) => {
            Ok((scene.clone(), String::new()))
        }
        Err(
            error @ (RefitError::FromFile
            | RefitError::Keys { .. }
            | RefitError::Active { .. }
            | RefitError::ActiveShape { .. }
            | RefitError::Input(BuildError::TooLarge { .. })),
        ) => Ok((scene.clone(), format!("{way} refused: {error}"))),
        Err(error) => Err(format!("{what}{way}: {error}")),
    }
}

/// The tree as it is now in instances, of which some are in trees of instances of their own.
fn placed(random: &mut Random, life: &Life, what: &str) -> Outcome {
    let scene = &life.scene;
    if scene.len() > 300 || scene.places.scale > 1e20 {
        return Ok(());
    }
    let brute = BruteForce::of_scene(&scene.meshes, scene.shapes()).map_err(|error| error.to_string())?;
    let of_balls = scene.balls.iter().map(|(ball, _)| ball.mask).collect();
    let masks = scene.meshes.iter().map(|mesh| vec![mesh.mask; mesh.len()]).chain([of_balls]).collect();
    let leaf = Brute::Tree(Arc::new(Leaf { brute, masks }));
    let away = |random: &mut Random| DAffine3::from_translation(random.vec() * scene.places.scale * 3.0);
    let mut one = || (Instance::new(life.tree.clone(), away(random)), leaf.clone());
    let inner = vec![one(), one()];
    let build = |random: &mut Random, instances: Vec<(Instance, Brute)>| {
        let params = wide(random);
        match InstanceTree::build(instances.iter().map(|(of, _)| of.clone()).collect(), &params) {
            Ok(tree) => Ok(Some(Placed { tree: Arc::new(tree), instances })),
            Err(mbkd::InstanceError::Build(error)) if is_documented(&error) => Ok(None),
            Err(error) => Err(format!("{what}: placed by {params:?}: {error}")),
        }
    };
    let Some(inner) = build(random, inner)? else { return Ok(()) };
    check_placed(random, &inner, scene.places.scale, &format!("{what}, placed"))?;
    let inner = Arc::new(inner);
    let outer = vec![
        (Instance::new(inner.tree.clone(), away(random)), Brute::Instances(inner)),
        (Instance::new(life.tree.clone(), DAffine3::IDENTITY), leaf.clone()),
    ];
    let Some(outer) = build(random, outer)? else { return Ok(()) };
    check_placed(random, &outer, scene.places.scale, &format!("{what}, placed twice"))
}
