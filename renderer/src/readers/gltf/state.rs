//! The hierarchy at one time: world transforms, morph weights, and the resulting vertices.

use super::animation::{Clip, Track};
use super::primitive::Primitive;
use super::{GltfModel, Local};
use crate::readers::FormatError;
use mbkd::glam::{DMat4, DVec3, Vec3};
use mbkd_scenes::View;

/// All nodes at one time of a clip.
pub struct State {
    world: Vec<DMat4>,
    weights: Vec<Option<Vec<f32>>>,
}

impl State {
    /// Applies a clip at a time, then computes world transforms from the roots down.
    pub fn new(model: &GltfModel, clip: Option<&Clip>, time: f64) -> State {
        let mut locals: Vec<Local> = model.nodes.iter().map(|node| node.local).collect();
        let mut weights: Vec<Option<Vec<f32>>> = model.nodes.iter().map(|node| node.weights.clone()).collect();
        for channel in clip.iter().flat_map(|clip| &clip.channels) {
            let node = channel.node;
            let (translation, rotation, scale) = locals[node].parts();
            let moved = |translation, rotation, scale| Local::Parts { translation, rotation, scale };
            match &channel.track {
                Track::Translation(keys) => locals[node] = moved(keys.at(time), rotation, scale),
                Track::Rotation(keys) => locals[node] = moved(translation, keys.at(time), scale),
                Track::Scale(keys) => locals[node] = moved(translation, rotation, keys.at(time)),
                Track::Weights(keys) => weights[node] = Some(keys.at(time)),
            }
        }
        let mut world = vec![DMat4::IDENTITY; locals.len()];
        for &(node, parent) in &model.hierarchy.order {
            let local = locals[node].matrix();
            world[node] = parent.map_or(local, |parent| world[parent] * local);
        }
        State { world, weights }
    }

    /// The vertices of a primitive of a node's mesh.
    pub fn vertices(
        &self,
        model: &GltfModel,
        node: usize,
        mesh: usize,
        p: &Primitive,
    ) -> Result<Vec<Vec3>, FormatError> {
        let weights = self.weights[node].as_ref().unwrap_or(&model.weights[mesh]);
        let morphed = |i: usize| {
            let offsets = p.targets.iter().zip(weights);
            offsets.fold(p.positions[i], |sum, (target, &weight)| sum + target[i] * f64::from(weight))
        };
        let skin = model.nodes[node].skin.map(|skin| (skin, &model.skins[skin]));
        let Some((number, skin)) = skin.filter(|_| !p.influences.is_empty()) else {
            let world = self.world[node];
            return Ok((0..p.positions.len()).map(|i| world.transform_point3(morphed(i)).as_vec3()).collect());
        };
        let pairs = skin.joints.iter().zip(&skin.inverse_bind);
        let joints: Vec<DMat4> = pairs.map(|(&joint, inverse)| self.world[joint] * *inverse).collect();
        let mut positions = Vec::with_capacity(p.positions.len());
        for (i, influences) in p.influences.iter().enumerate() {
            let at = morphed(i);
            let (mut sum, mut total) = (DVec3::ZERO, 0.0);
            for &(joint, weight) in influences {
                let Some(matrix) = joints.get(joint as usize) else {
                    let what = format!("vertex {i} names joint {joint}, but skin {number} has {}", joints.len());
                    return Err(FormatError::new(format!("mesh {mesh}"), what));
                };
                sum += matrix.transform_point3(at) * weight;
                total += weight;
            }
            // Weights should sum to 1; stored as bytes they do so only approximately. A vertex without weights is not
            // moved.
            positions.push(if total > 0.0 { sum / total } else { at }.as_vec3());
        }
        Ok(positions)
    }

    /// The view of the first camera of the scene.
    pub fn view(&self, model: &GltfModel) -> Option<View> {
        let camera = |&node: &usize| model.nodes[node].camera.map(|height| (node, height));
        let (node, height) = model.hierarchy.shown.iter().find_map(camera)?;
        let world = self.world[node];
        let position = world.w_axis.truncate().as_vec3();
        // A camera looks along its own -z, with y up.
        let forward = -world.z_axis.truncate().normalize_or_zero();
        // Far from zero, f32 has no places that are near the camera and in its direction.
        let reach = f64::from(position.abs().max_element() / 64.0).max(1.0);
        let view = View {
            position,
            target: (position.as_dvec3() + forward * reach).as_vec3(),
            up: world.y_axis.truncate().normalize_or_zero().as_vec3(),
            height,
        };
        (position.is_finite() && forward.is_finite()).then_some(view)
    }
}
