//! A writer of GLB files: nodes, meshes of painted shapes, skins and one clip, in the order in which they are added.

use super::paint::{Look, Paint};
use gltf::binary::{Glb, Header};
use gltf::json::accessor::{ComponentType, GenericComponentType, Type};
use gltf::json::animation::{Channel, Interpolation, Property, Sampler, Target};
use gltf::json::extensions::material::{EmissiveStrength, EmissiveStrengthFactor};
use gltf::json::material::{EmissiveFactor, PbrBaseColorFactor, PbrMetallicRoughness, StrengthFactor};
use gltf::json::mesh::{Mode, Primitive, Semantic};
use gltf::json::scene::UnitQuaternion;
use gltf::json::validation::{Checked, USize64};
use gltf::json::{
    Accessor, Animation, Buffer, Camera, Index, Material, Mesh, Node, Root, Scene, Skin, Value, buffer, camera,
    extensions,
};
use mbkd::Keys;
use mbkd::glam::Vec3;
use mbkd_renderer::sampling::cos_sin_f64;
use mbkd_scenes::Shape;
use std::collections::BTreeMap;

/// The accessors of vertices by their semantic: positions, joints, weights.
pub type Attributes = BTreeMap<Checked<Semantic>, Index<Accessor>>;

/// Shapes, each of one paint.
pub type Parts = Vec<(Paint, Shape)>;

/// The shape of that paint among the parts; inserts an empty one if there is none yet.
pub fn of(parts: &mut Parts, paint: Paint) -> &mut Shape {
    let at = parts.iter().position(|part| part.0 == paint).unwrap_or_else(|| {
        parts.push((paint, Shape::default()));
        parts.len() - 1
    });
    &mut parts[at].1
}

/// A file being written.
pub struct Writer {
    root: Root,
    binary: Vec<u8>,
    clip: Animation,
    /// Seconds of the clip.
    seconds: f32,
    materials: Vec<(Paint, Index<Material>)>,
    /// Accessors of evenly spaced times, by their number.
    times: BTreeMap<usize, Index<Accessor>>,
}

impl Writer {
    /// An empty file, whose clip has a name and a length.
    pub fn new(clip: &str, seconds: f32) -> Writer {
        let mut root = Root::default();
        root.asset.generator = Some("mbkd-renderer".into());
        root.asset.copyright = Some("MIT OR Apache-2.0".into());
        root.extensions_used.push("KHR_materials_emissive_strength".into());
        let clip = Animation {
            name: Some(clip.into()),
            channels: vec![],
            samplers: vec![],
            extensions: None,
            extras: Default::default(),
        };
        Writer { root, binary: vec![], clip, seconds, materials: vec![], times: BTreeMap::new() }
    }

    /// A node, on a parent or at the root of the scene.
    pub fn node(&mut self, name: &str, parent: Option<Index<Node>>, translation: Vec3) -> Index<Node> {
        let translation = (translation != Vec3::ZERO).then_some(translation.to_array());
        let node = self.root.push(Node { name: Some(name.into()), translation, ..Node::default() });
        match parent {
            Some(parent) => self.root.nodes[parent.value()].children.get_or_insert_default().push(node),
            None => self.scene().nodes.push(node),
        }
        node
    }

    /// Turns a node about an axis, by an angle in turns.
    pub fn turn(&mut self, node: Index<Node>, axis: Vec3, turns: f32) {
        self.root.nodes[node.value()].rotation = Some(UnitQuaternion(rotation(axis, turns)));
    }

    /// Attaches a mesh to a node, with a skin if it has one.
    pub fn show(&mut self, node: Index<Node>, mesh: Index<Mesh>, skin: Option<Index<Skin>>) {
        let node = &mut self.root.nodes[node.value()];
        (node.mesh, node.skin) = (Some(mesh), skin);
    }

    /// Attaches a camera to a node: it looks along the node's -z, with this vertical angle in radians.
    pub fn camera(&mut self, node: Index<Node>, angle: f32) {
        let (extensions, extras) = (None, Default::default());
        let perspective =
            camera::Perspective { aspect_ratio: None, yfov: angle, zfar: None, znear: 0.1, extensions, extras };
        let camera = self.root.push(Camera {
            name: None,
            orthographic: None,
            perspective: Some(perspective),
            type_: Checked::Valid(camera::Type::Perspective),
            extensions: None,
            extras: Default::default(),
        });
        self.root.nodes[node.value()].camera = Some(camera);
    }

    /// A mesh of painted shapes.
    pub fn mesh(&mut self, name: &str, parts: Parts) -> Index<Mesh> {
        let mut primitives = Vec::new();
        for (paint, shape) in parts {
            let mesh = shape.fixed();
            let Keys::F32(keys) = &mesh.keys else { unreachable!("shapes are single precision") };
            let attributes = self.positions(&keys[0]);
            primitives.push(self.primitive(attributes, &mesh.indices, paint));
        }
        self.mesh_of(name, primitives)
    }

    /// A mesh of primitives.
    pub fn mesh_of(&mut self, name: &str, primitives: Vec<Primitive>) -> Index<Mesh> {
        let extras = Default::default();
        self.root.push(Mesh { name: Some(name.into()), primitives, weights: None, extensions: None, extras })
    }

    /// A primitive of triangles between vertices.
    pub fn primitive(&mut self, attributes: Attributes, triangles: &[[u32; 3]], paint: Paint) -> Primitive {
        let corners = || triangles.iter().flatten();
        let (bytes, component): (Vec<u8>, _) = match corners().max() {
            Some(&most) if most > 254 => {
                (corners().flat_map(|&i| (i as u16).to_le_bytes()).collect(), ComponentType::U16)
            }
            _ => (corners().map(|&i| i as u8).collect(), ComponentType::U8),
        };
        let indices = self.accessor(&bytes, corners().count(), component, Type::Scalar);
        let (mode, material) = (Checked::Valid(Mode::Triangles), Some(self.material(paint)));
        let (extensions, extras) = (None, Default::default());
        Primitive { attributes, indices: Some(indices), material, mode, targets: None, extensions, extras }
    }

    /// Vertices at these positions.
    pub fn positions(&mut self, positions: &[Vec3]) -> Attributes {
        let rows: Vec<[f32; 3]> = positions.iter().map(|p| p.to_array()).collect();
        BTreeMap::from([(Checked::Valid(Semantic::Positions), self.floats(&rows, Type::Vec3))])
    }

    /// Makes each vertex follow two joints, the second with a weight of so many 255ths.
    pub fn follow(&mut self, vertices: &mut Attributes, pairs: &[([u8; 2], u8)]) {
        let joints: Vec<u8> = pairs.iter().flat_map(|([a, b], _)| [*a, *b, 0, 0]).collect();
        let weights: Vec<u8> = pairs.iter().flat_map(|(_, second)| [255 - second, *second, 0, 0]).collect();
        let joints = self.accessor(&joints, pairs.len(), ComponentType::U8, Type::Vec4);
        let weights = self.accessor(&weights, pairs.len(), ComponentType::U8, Type::Vec4);
        self.root.accessors[weights.value()].normalized = true;
        vertices
            .extend([(Checked::Valid(Semantic::Joints(0)), joints), (Checked::Valid(Semantic::Weights(0)), weights)]);
    }

    /// A skin: joints and their positions in the space of the mesh.
    pub fn skin(&mut self, joints: &[(Index<Node>, Vec3)]) -> Index<Skin> {
        let inverse = |&(_, Vec3 { x, y, z }): &(Index<Node>, Vec3)| {
            [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, -x, -y, -z, 1.0]
        };
        let matrices: Vec<[f32; 16]> = joints.iter().map(inverse).collect();
        let inverse_bind_matrices = Some(self.floats(&matrices, Type::Mat4));
        let joints = joints.iter().map(|joint| joint.0).collect();
        let (extensions, extras) = (None, Default::default());
        self.root.push(Skin { name: None, joints, inverse_bind_matrices, skeleton: None, extensions, extras })
    }

    /// Rotates nodes about an axis, by angles in turns at so many evenly spaced times (0 to 1 over the clip).
    pub fn spin(&mut self, nodes: &[Index<Node>], axis: Vec3, keys: usize, turns: impl Fn(f32) -> f32) {
        let rows: Vec<[f32; 4]> = places(keys).map(|time| rotation(axis, turns(time))).collect();
        let output = self.floats(&rows, Type::Vec4);
        self.channels(nodes, Property::Rotation, keys, output);
    }

    /// Moves a node to positions at so many evenly spaced times.
    pub fn shift(&mut self, node: Index<Node>, keys: usize, place: impl Fn(f32) -> Vec3) {
        let rows: Vec<[f32; 3]> = places(keys).map(|time| place(time).to_array()).collect();
        let output = self.floats(&rows, Type::Vec3);
        self.channels(&[node], Property::Translation, keys, output);
    }

    /// The bytes of the file.
    pub fn finish(mut self) -> Vec<u8> {
        self.root.push(self.clip);
        self.root.scene = Some(Index::new(0));
        let (byte_length, extras) = (USize64::from(self.binary.len()), Default::default());
        self.root.push(Buffer { byte_length, name: None, uri: None, extensions: None, extras });
        let json = self.root.to_vec().expect("all keys of its maps are text");
        // The length is filled in when the file is written.
        let header = Header { magic: *b"glTF", version: 2, length: 0 };
        let file = Glb { header, json: json.into(), bin: Some(self.binary.into()) };
        file.to_vec().expect("memory takes all that is written to it")
    }

    fn scene(&mut self) -> &mut Scene {
        if self.root.scenes.is_empty() {
            self.root.push(Scene { name: None, nodes: vec![], extensions: None, extras: Default::default() });
        }
        &mut self.root.scenes[0]
    }

    fn material(&mut self, paint: Paint) -> Index<Material> {
        if let Some(known) = self.materials.iter().find(|known| known.0 == paint) {
            return known.1;
        }
        let Look { color: [r, g, b], metallic, roughness, glow } = paint.look();
        let shines = glow > 0.0;
        let emissive_strength = Some(EmissiveStrength { emissive_strength: EmissiveStrengthFactor(glow) });
        let material = self.root.push(Material {
            name: Some(format!("{paint:?}")),
            double_sided: true,
            pbr_metallic_roughness: PbrMetallicRoughness {
                base_color_factor: PbrBaseColorFactor([r, g, b, 1.0]),
                metallic_factor: StrengthFactor(metallic),
                roughness_factor: StrengthFactor(roughness),
                ..PbrMetallicRoughness::default()
            },
            emissive_factor: EmissiveFactor(if shines { [r, g, b] } else { [0.0; 3] }),
            extensions: shines.then_some(extensions::material::Material { emissive_strength }),
            ..Material::default()
        });
        self.materials.push((paint, material));
        material
    }

    fn channels(&mut self, nodes: &[Index<Node>], path: Property, keys: usize, output: Index<Accessor>) {
        let input = self.evenly(keys);
        let interpolation = Checked::Valid(Interpolation::Linear);
        let sampler = Sampler { input, output, interpolation, extensions: None, extras: Default::default() };
        let sampler = Index::push(&mut self.clip.samplers, sampler);
        for &node in nodes {
            let target = Target { node, path: Checked::Valid(path), extensions: None, extras: Default::default() };
            self.clip.channels.push(Channel { sampler, target, extensions: None, extras: Default::default() });
        }
    }

    /// An accessor of so many evenly spaced times over the clip.
    fn evenly(&mut self, keys: usize) -> Index<Accessor> {
        if let Some(known) = self.times.get(&keys) {
            return *known;
        }
        let rows: Vec<[f32; 1]> = places(keys).map(|time| [time * self.seconds]).collect();
        let times = self.floats(&rows, Type::Scalar);
        self.times.insert(keys, times);
        times
    }

    /// Rows of floats.
    fn floats<const N: usize>(&mut self, rows: &[[f32; N]], kind: Type) -> Index<Accessor> {
        let bytes: Vec<u8> = rows.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
        let accessor = self.accessor(&bytes, rows.len(), ComponentType::F32, kind);
        let bound = |pick: fn(f32, f32) -> f32| {
            let of = |column: usize| rows.iter().map(|row| row[column]).reduce(pick).unwrap_or(0.0);
            Some((0..N).map(|column| Value::from(of(column))).collect::<Value>())
        };
        // The standard requires bounds for positions and times.
        if matches!(kind, Type::Scalar | Type::Vec3) {
            let it = &mut self.root.accessors[accessor.value()];
            (it.min, it.max) = (bound(f32::min), bound(f32::max));
        }
        accessor
    }

    fn accessor(&mut self, bytes: &[u8], count: usize, component: ComponentType, kind: Type) -> Index<Accessor> {
        self.binary.resize(self.binary.len().next_multiple_of(4), 0);
        let view = self.root.push(buffer::View {
            buffer: Index::new(0),
            byte_length: USize64::from(bytes.len()),
            byte_offset: Some(USize64::from(self.binary.len())),
            byte_stride: None,
            name: None,
            target: None,
            extensions: None,
            extras: Default::default(),
        });
        self.binary.extend_from_slice(bytes);
        self.root.push(Accessor {
            buffer_view: Some(view),
            byte_offset: None,
            count: USize64::from(count),
            component_type: Checked::Valid(GenericComponentType(component)),
            type_: Checked::Valid(kind),
            min: None,
            max: None,
            name: None,
            normalized: false,
            sparse: None,
            extensions: None,
            extras: Default::default(),
        })
    }
}

/// So many numbers evenly spaced from 0 to 1.
fn places(keys: usize) -> impl Iterator<Item = f32> {
    (0..keys).map(move |key| key as f32 / (keys - 1) as f32)
}

/// The quaternion of an angle in turns about a unit axis.
fn rotation(axis: Vec3, turns: f32) -> [f32; 4] {
    let (c, s) = cos_sin_f64(0.5 * f64::from(turns));
    let [x, y, z] = (axis * s as f32).to_array();
    [x, y, z, c as f32]
}
