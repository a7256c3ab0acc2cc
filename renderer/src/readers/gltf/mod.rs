//! glTF 2.0 and GLB: a hierarchy of nodes, posed by animations, with meshes that may be morphed and skinned.
//!
//! The gltf crate parses and validates the JSON. Numbers are read by [`accessor`], which checks every bound; poses are
//! computed in f64 in the order of the standard: animated local transforms, world transforms from the roots down, morph
//! targets, then either the skin's joints or the node's own transform.

mod accessor;
mod animation;
mod container;
mod primitive;
mod state;

use super::{FormatError, MOST_VERTICES, Part, Pose, ReadError, check_positions, picture};
use crate::materials::{Finish, Surface, Texture};
use crate::staging::picture_height;
use accessor::Data;
use animation::{Clip, unit};
use mbkd::glam::{DMat4, DQuat, DVec3, Vec3};
use mbkd_scenes::Camera;
use primitive::Primitive;
use state::State;
use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A glTF file, read.
pub struct GltfModel {
    file: PathBuf,
    nodes: Vec<Node>,
    hierarchy: Hierarchy,
    meshes: Vec<Vec<Primitive>>,
    /// Default morph weights of each mesh.
    weights: Vec<Vec<f32>>,
    skins: Vec<Skin>,
    clips: Vec<Clip>,
}

/// The nodes and their parents.
struct Hierarchy {
    /// All nodes, parents before children, with their parent.
    order: Vec<(usize, Option<usize>)>,
    /// Nodes of the scene, in the order of the file.
    shown: Vec<usize>,
}

struct Node {
    local: Local,
    mesh: Option<usize>,
    skin: Option<usize>,
    weights: Option<Vec<f32>>,
    /// Height of the picture at distance 1, if the node has a camera.
    camera: Option<f32>,
}

/// A transform relative to the parent.
#[derive(Clone, Copy)]
enum Local {
    Matrix(DMat4),
    Parts { translation: DVec3, rotation: DQuat, scale: DVec3 },
}

struct Skin {
    joints: Vec<usize>,
    inverse_bind: Vec<DMat4>,
}

impl GltfModel {
    /// Reads the bytes of a .gltf or .glb file; buffers and pictures may lie next to it.
    pub fn parse(bytes: &[u8], file: &Path) -> Result<GltfModel, ReadError> {
        GltfModel::read(bytes, file).map_err(|e| e.in_file(file))
    }

    fn read(bytes: &[u8], file: &Path) -> Result<GltfModel, FormatError> {
        let (document, buffers) = container::open(bytes, file)?;
        let data = Data::new(buffers);
        let textures = textures(&document, &data, file)?;
        let (mut meshes, mut weights) = (Vec::new(), Vec::new());
        for mesh in document.meshes() {
            let mut primitives = Vec::new();
            for primitive in mesh.primitives() {
                let place = format!("mesh {}, primitive {}", mesh.index(), primitive.index());
                let surface = surface(&primitive.material(), &textures);
                primitives.extend(primitive::read(&primitive, &place, &data, surface)?);
            }
            meshes.push(primitives);
            weights.push(mesh.weights().unwrap_or(&[]).to_vec());
        }
        let nodes: Vec<Node> = document.nodes().map(|node| Node::read(&node)).collect();
        let skins = document.skins().map(|skin| Skin::read(&skin, &data)).collect::<Result<Vec<_>, _>>()?;
        let targets = |node: usize| -> usize {
            let primitives = nodes[node].mesh.map_or(&[][..], |mesh| &meshes[mesh]);
            primitives.iter().map(|p| p.targets.len()).max().unwrap_or(0)
        };
        let clips =
            document.animations().map(|a| animation::clip(&a, &data, targets)).collect::<Result<Vec<_>, _>>()?;
        let hierarchy = hierarchy(&document)?;
        Ok(GltfModel { file: file.into(), nodes, hierarchy, meshes, weights, skins, clips })
    }

    /// The clip with that name or number; the first by default, `None` if nothing is animated.
    fn clip(&self, wanted: Option<&str>) -> Result<Option<&Clip>, ReadError> {
        let Some(wanted) = wanted else { return Ok(self.clips.first()) };
        let by_name = self.clips.iter().find(|clip| clip.name == wanted);
        let by_number = || self.clips.get(wanted.parse::<usize>().ok()?);
        match by_name.or_else(by_number) {
            Some(clip) => Ok(Some(clip)),
            None => {
                let names: Vec<&str> = self.clips.iter().map(|clip| clip.name.as_str()).collect();
                let what = format!("there is no clip `{wanted}`; there are {}: {}", names.len(), names.join(", "));
                Err(FormatError::new("animations", what).in_file(&self.file))
            }
        }
    }

    /// The name of a clip, if it has one.
    pub fn clip_name(&self, clip: Option<&str>) -> Result<Option<&str>, ReadError> {
        Ok(self.clip(clip)?.map(|clip| clip.name.as_str()).filter(|name| !name.is_empty()))
    }

    /// The time span of a clip.
    pub fn span(&self, clip: Option<&str>) -> Result<Option<(f64, f64)>, ReadError> {
        Ok(self.clip(clip)?.map(|clip| clip.span).filter(|(first, last)| first < last))
    }

    /// Poses the model at some times of a clip.
    pub fn pose(&self, clip: Option<&str>, times: &[f64]) -> Result<Pose, ReadError> {
        self.pose_checked(self.clip(clip)?, times).map_err(|e| e.in_file(&self.file))
    }

    fn pose_checked(&self, clip: Option<&Clip>, times: &[f64]) -> Result<Pose, FormatError> {
        // One part for each primitive of each node with a mesh.
        let instances = || {
            let of_node = |&node: &usize| self.nodes[node].mesh.map(|mesh| (node, mesh));
            self.hierarchy
                .shown
                .iter()
                .filter_map(of_node)
                .flat_map(|(node, mesh)| self.meshes[mesh].iter().map(move |p| (node, mesh, p)))
        };
        let vertices =
            instances().fold(0usize, |sum, (_, _, p)| sum.saturating_add(p.positions.len() + p.indices.len()));
        if vertices.saturating_mul(times.len()) > MOST_VERTICES {
            return Err(FormatError::new("scene", format!("{vertices} vertices at {} keys are too many", times.len())));
        }
        if vertices == 0 {
            return Err(FormatError::new("scene", "there are no triangles in it"));
        }
        let mut parts: Vec<Part> = instances()
            .map(|(_, _, p)| Part { indices: p.indices.clone(), keys: vec![], surface: p.surface.clone() })
            .collect();
        let mut views = Vec::new();
        for &time in times {
            let state = State::new(self, clip, time);
            for ((node, mesh, primitive), part) in instances().zip(&mut parts) {
                let positions = state.vertices(self, node, mesh, primitive)?;
                check_positions(&format!("node {node} at {time} s"), &positions)?;
                part.keys.push(positions);
            }
            views.extend(state.view(self));
        }
        let camera = (views.len() == times.len() && !views.is_empty()).then_some(Camera { keys: views });
        Ok(Pose { parts, camera })
    }
}

impl Node {
    fn read(node: &gltf::Node) -> Node {
        let local = match node.transform() {
            gltf::scene::Transform::Matrix { matrix } => Local::Matrix(matrix_of(matrix)),
            gltf::scene::Transform::Decomposed { translation, rotation, scale } => Local::Parts {
                translation: DVec3::from(translation.map(f64::from)),
                rotation: unit(DQuat::from_array(rotation.map(f64::from))),
                scale: DVec3::from(scale.map(f64::from)),
            },
        };
        let camera = node.camera().and_then(|camera| match camera.projection() {
            gltf::camera::Projection::Perspective(p) => Some(picture_height(f64::from(p.yfov()))),
            gltf::camera::Projection::Orthographic(_) => None,
        });
        Node {
            local,
            mesh: node.mesh().map(|mesh| mesh.index()),
            skin: node.skin().map(|skin| skin.index()),
            weights: node.weights().map(<[f32]>::to_vec),
            camera: camera.filter(|height| *height > 0.0 && height.is_finite()),
        }
    }
}

impl Local {
    fn matrix(self) -> DMat4 {
        match self {
            Local::Matrix(matrix) => matrix,
            Local::Parts { translation, rotation, scale } => {
                DMat4::from_scale_rotation_translation(scale, rotation, translation)
            }
        }
    }

    /// The components, to be replaced by an animation; the standard forbids animating a matrix, of which only the
    /// translation is used here.
    fn parts(self) -> (DVec3, DQuat, DVec3) {
        match self {
            Local::Matrix(matrix) => (matrix.w_axis.truncate(), DQuat::IDENTITY, DVec3::ONE),
            Local::Parts { translation, rotation, scale } => (translation, rotation, scale),
        }
    }
}

impl Skin {
    fn read(skin: &gltf::Skin, data: &Data) -> Result<Skin, FormatError> {
        let joints: Vec<usize> = skin.joints().map(|joint| joint.index()).collect();
        let inverse_bind = match skin.inverse_bind_matrices() {
            Some(accessor) => {
                data.floats::<16>(&accessor)?.into_iter().map(|m| DMat4::from_cols_array(&m.map(f64::from))).collect()
            }
            None => vec![DMat4::IDENTITY; joints.len()],
        };
        if inverse_bind.len() < joints.len() {
            let what = format!("{} inverse bind matrices for {} joints", inverse_bind.len(), joints.len());
            return Err(FormatError::new(format!("skin {}", skin.index()), what));
        }
        Ok(Skin { joints, inverse_bind })
    }
}

/// All nodes with their parents, parents first, and the nodes of the default scene (of all scenes, if there is none). A
/// node with two parents or in a cycle is rejected.
fn hierarchy(document: &gltf::Document) -> Result<Hierarchy, FormatError> {
    let count = document.nodes().len();
    let children: Vec<Vec<usize>> = document.nodes().map(|n| n.children().map(|c| c.index()).collect()).collect();
    let mut parent = vec![None; count];
    for (node, children) in children.iter().enumerate() {
        for &child in children {
            if parent[child].replace(node).is_some() {
                return Err(FormatError::new(format!("node {child}"), "has two parents"));
            }
        }
    }
    // Joints may lie outside the scene, so every root counts.
    let mut order: Vec<(usize, Option<usize>)> =
        (0..count).filter(|&node| parent[node].is_none()).map(|node| (node, None)).collect();
    let mut next = 0;
    while let Some(&(node, _)) = order.get(next) {
        order.extend(children[node].iter().map(|&child| (child, Some(node))));
        next += 1;
    }
    if order.len() < count {
        // Every node has one parent at most, so a node that no root reaches is in a cycle.
        let reached: HashSet<usize> = order.iter().map(|(node, _)| *node).collect();
        let node = (0..count).find(|node| !reached.contains(node)).unwrap_or(0);
        return Err(FormatError::new(format!("node {node}"), "is among its own ancestors"));
    }
    let Some(scene) = document.default_scene().or_else(|| document.scenes().next()) else {
        return Ok(Hierarchy { order, shown: (0..count).collect() });
    };
    let mut shown: HashSet<usize> = scene.nodes().map(|node| node.index()).collect();
    for (node, parent) in &order {
        if parent.is_some_and(|parent| shown.contains(&parent)) {
            shown.insert(*node);
        }
    }
    Ok(Hierarchy { shown: (0..count).filter(|node| shown.contains(node)).collect(), order })
}

fn matrix_of(columns: [[f32; 4]; 4]) -> DMat4 {
    DMat4::from_cols_array_2d(&columns.map(|column| column.map(f64::from)))
}

fn surface(material: &gltf::Material, textures: &[Arc<Texture>]) -> Surface {
    let pbr = material.pbr_metallic_roughness();
    let [r, g, b, _] = pbr.base_color_factor();
    let channel = |x: f32| if x.is_nan() { 0.0 } else { x.clamp(0.0, 1.0) };
    let color = Vec3::new(channel(r), channel(g), channel(b));
    // One set of texture coordinates is read: textures that use another are ignored.
    let set = primitive::coordinates(material);
    let picture = |info: Option<gltf::texture::Info>| {
        let info = info.filter(|info| info.tex_coord() == set)?;
        textures.get(info.texture().source().index()).cloned()
    };
    // In the gltf crate a material without an index is the default material of primitives without one.
    let finish = material.index().map(|_| Finish {
        metallic: channel(pbr.metallic_factor()),
        roughness: channel(pbr.roughness_factor()),
        texture: picture(pbr.metallic_roughness_texture()),
    });
    let strength = material.emissive_strength().unwrap_or(1.0);
    let emission = Vec3::from(material.emissive_factor().map(channel)) * if strength > 0.0 { strength } else { 0.0 };
    let emission_texture = picture(material.emissive_texture());
    Surface { texture: picture(pbr.base_color_texture()), finish, emission, emission_texture, ..Surface::plain(color) }
}

/// All textures of the file.
fn textures(document: &gltf::Document, data: &Data, file: &Path) -> Result<Vec<Arc<Texture>>, FormatError> {
    let mut decoder = picture::Decoder::new();
    let read = |image: gltf::Image| {
        let loaded = match image.source() {
            gltf::image::Source::View { view, .. } => data.view(&view).map(<[u8]>::to_vec),
            gltf::image::Source::Uri { uri, .. } => container::resource(uri, file),
        };
        let texture = loaded.and_then(|bytes| decoder.decode(&bytes));
        texture.map(Arc::new).map_err(|what| FormatError::new(format!("image {}", image.index()), what))
    };
    document.images().map(read).collect()
}
