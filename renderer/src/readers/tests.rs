//! Poses compared with hand-computed and independently baked ones, and malformed files.

use super::*;
use mbkd::glam::Vec2;
use std::f32::consts::FRAC_1_SQRT_2;

/// A GLB file being written: JSON around buffer views of one binary chunk.
#[derive(Default)]
struct Glb {
    bin: Vec<u8>,
    views: Vec<String>,
    accessors: Vec<String>,
}

impl Glb {
    fn view(&mut self, bytes: &[u8]) -> usize {
        self.bin.resize(self.bin.len().next_multiple_of(4), 0);
        self.views.push(format!(r#"{{"buffer":0,"byteOffset":{},"byteLength":{}}}"#, self.bin.len(), bytes.len()));
        self.bin.extend_from_slice(bytes);
        self.views.len() - 1
    }

    fn accessor(&mut self, kind: &str, component: u32, count: usize, bytes: &[u8], more: &str) -> usize {
        let view = self.view(bytes);
        self.accessors.push(format!(
            r#"{{"bufferView":{view},"componentType":{component},"count":{count},"type":"{kind}"{more}}}"#
        ));
        self.accessors.len() - 1
    }

    fn floats<const N: usize>(&mut self, rows: &[[f32; N]]) -> usize {
        let kind = ["", "SCALAR", "VEC2", "VEC3", "VEC4"].get(N).copied().unwrap_or("MAT4");
        let bytes: Vec<u8> = rows.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
        let bound = |pick: fn(f32, f32) -> f32| -> String {
            let at = |i: usize| rows.iter().map(|row| row[i]).reduce(pick).unwrap_or(0.0).to_string();
            (0..N).map(at).collect::<Vec<_>>().join(",")
        };
        let more = format!(r#","min":[{}],"max":[{}]"#, bound(f32::min), bound(f32::max));
        self.accessor(kind, 5126, rows.len(), &bytes, &more)
    }

    fn finish(&self, rest: &str) -> Vec<u8> {
        let mut json = format!(
            r#"{{"asset":{{"version":"2.0"}},"buffers":[{{"byteLength":{}}}],"bufferViews":[{}],"accessors":[{}],{rest}}}"#,
            self.bin.len(),
            self.views.join(","),
            self.accessors.join(",")
        );
        json.extend(std::iter::repeat_n(' ', json.len().next_multiple_of(4) - json.len()));
        let mut bin = self.bin.clone();
        bin.resize(bin.len().next_multiple_of(4), 0);
        let mut bytes = b"glTF".to_vec();
        let word = |bytes: &mut Vec<u8>, x: usize| bytes.extend((x as u32).to_le_bytes());
        word(&mut bytes, 2);
        word(&mut bytes, 12 + 16 + json.len() + bin.len());
        word(&mut bytes, json.len());
        bytes.extend(b"JSON");
        bytes.extend(json.as_bytes());
        word(&mut bytes, bin.len());
        bytes.extend(b"BIN\0");
        bytes.extend(bin);
        bytes
    }
}

/// Two triangles on two joints; the second joint, one up, rotates by a quarter turn about z in one second. Vertices:
/// one on each joint alone, one shared 3 : 1, one shared evenly. A morph target lifts the last along z.
fn arm() -> Vec<u8> {
    let mut glb = Glb::default();
    glb.floats::<3>(&[[0.0, 0.0, 0.0], [0.0, 2.0, 0.0], [1.0, 1.0, 0.0], [-1.0, 1.0, 0.0]]);
    glb.accessor("SCALAR", 5123, 6, &[0, 0, 2, 0, 1, 0, 0, 0, 1, 0, 3, 0], "");
    glb.accessor("VEC4", 5121, 4, &[0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0], "");
    // Weights as normalized bytes: 255 : 0, 191 : 64, 128 : 127 as files have them.
    glb.accessor(
        "VEC4",
        5121,
        4,
        &[255, 0, 0, 0, 255, 0, 0, 0, 191, 64, 0, 0, 128, 127, 0, 0],
        r#","normalized":true"#,
    );
    let identity = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0];
    let mut down = identity;
    down[13] = -1.0;
    glb.floats::<16>(&[identity, down]);
    glb.floats::<1>(&[[0.0], [1.0]]);
    glb.floats::<4>(&[[0.0, 0.0, 0.0, 1.0], [0.0, 0.0, FRAC_1_SQRT_2, FRAC_1_SQRT_2]]);
    // The morph target: no view at all, one sparse element.
    let (at, new) = (glb.view(&[3]), glb.view(&[0.0f32, 0.0, 4.0].map(f32::to_le_bytes).concat()));
    glb.accessors.push(format!(
        r#"{{"componentType":5126,"count":4,"type":"VEC3","min":[0,0,0],"max":[0,0,4],"sparse":{{"count":1,"indices":{{"bufferView":{at},"componentType":5121}},"values":{{"bufferView":{new}}}}}}}"#
    ));
    glb.floats::<1>(&[[0.0], [0.5]]);
    glb.floats::<2>(&[[0.0, 0.0], [0.0, 1.0], [1.0, 0.0], [1.0, 1.0]]);
    glb.finish(
        r#""scene":0,"scenes":[{"nodes":[0,2]}],
        "nodes":[{"name":"root","translation":[10,0,0],"children":[1]},{"name":"elbow","translation":[0,1,0]},
                 {"mesh":0,"skin":0,"translation":[99,99,99]}],
        "meshes":[{"weights":[0],"primitives":[{"attributes":{"POSITION":0,"JOINTS_0":2,"WEIGHTS_0":3,"TEXCOORD_0":9},
                   "indices":1,"material":0,"targets":[{"POSITION":7}]}]}],
        "materials":[{"pbrMetallicRoughness":{"baseColorFactor":[0.5,0.25,1,1],"roughnessFactor":0.75},
                      "emissiveFactor":[1,0.5,0],"extensions":{"KHR_materials_emissive_strength":{"emissiveStrength":4}}}],
        "skins":[{"joints":[0,1],"inverseBindMatrices":4}],
        "animations":[{"name":"bend","samplers":[{"input":5,"output":6,"interpolation":"LINEAR"},
                        {"input":5,"output":8,"interpolation":"STEP"}],
                       "channels":[{"sampler":0,"target":{"node":1,"path":"rotation"}},
                                   {"sampler":1,"target":{"node":2,"path":"weights"}}]}]"#,
    )
}

fn parse(bytes: &[u8]) -> Result<GltfModel, ReadError> {
    GltfModel::parse(bytes, Path::new("sample.glb"))
}

#[test]
fn a_skinned_morphing_arm_is_posed_as_computed_by_hand() {
    let pose = parse(&arm()).unwrap().pose(Some("bend"), &[-1.0, 0.5, 1.0]).unwrap();
    let [start, middle, end] = &pose.parts[0].keys[..] else { panic!("three keys") };
    let near = |found: Vec3, x: f32, y: f32, z: f32| {
        assert!(found.distance(Vec3::new(x, y, z)) < 1e-5, "{found} is not {x} {y} {z}");
    };
    // The skin ignores the mesh's own node; the root joint moves everything 10 to the right.
    near(start[1], 10.0, 2.0, 0.0);
    near(start[3], 9.0, 1.0, 0.0);
    // Half way, the elbow has rotated by 45 degrees about (10, 1).
    near(middle[0], 10.0, 0.0, 0.0);
    near(middle[1], 10.0 - FRAC_1_SQRT_2, 1.0 + FRAC_1_SQRT_2, 0.0);
    // At the end joint 1 maps (1, 1) to (10, 2) and (-1, 1) to (10, 0); weights mix them; STEP has switched to half of
    // the morph target.
    near(end[1], 9.0, 1.0, 0.0);
    let (a, b) = (191.0 / 255.0, 64.0 / 255.0);
    near(end[2], 11.0 * a + 10.0 * b, a + 2.0 * b, 0.0);
    let (a, b) = (128.0 / 255.0, 127.0 / 255.0);
    near(end[3], 9.0 * a + 10.0 * b, a, 2.0);
    let surface = &pose.parts[0].surface;
    assert_eq!((surface.color, surface.emission), (Vec3::new(0.5, 0.25, 1.0), Vec3::new(4.0, 2.0, 0.0)));
    let finish = surface.finish.as_ref().unwrap();
    assert_eq!((finish.metallic, finish.roughness, finish.texture.is_none()), (1.0, 0.75, true), "the default is 1");
    assert_eq!(pose.parts[0].surface.uvs, Vec::<Vec2>::new(), "no texture, no coordinates");
}

#[test]
fn node_trees_strips_and_cameras() {
    let mut glb = Glb::default();
    glb.floats::<3>(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [1.0, 1.0, 0.0]]);
    let bytes = glb.finish(
        r#""scenes":[{"nodes":[0]}],"cameras":[{"type":"perspective","perspective":{"yfov":1.5707963,"znear":0.1}}],
        "nodes":[{"scale":[2,2,2],"children":[1,2]},
                 {"mesh":0,"rotation":[0,0.70710678,0,0.70710678],"translation":[0,0,3]},{"camera":0,"translation":[0,0,5]}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0},"mode":5},{"attributes":{"POSITION":0},"mode":6},
                                  {"attributes":{"POSITION":0},"mode":0}]}]"#,
    );
    let pose = parse(&bytes).unwrap().pose(None, &[0.0]).unwrap();
    assert_eq!(pose.parts.len(), 2, "points are left out");
    assert_eq!(pose.parts[0].indices, [[0, 1, 2], [2, 1, 3]]);
    assert_eq!(pose.parts[1].indices, [[0, 1, 2], [0, 2, 3]]);
    // A quarter turn about y maps x to -z; then up 3, then twice as large.
    assert!(pose.parts[0].keys[0][1].distance(Vec3::new(0.0, 0.0, 4.0)) < 1e-5);
    let view = pose.camera.unwrap().keys[0];
    assert_eq!(view.position, Vec3::new(0.0, 0.0, 10.0));
    assert!((view.height - 2.0).abs() < 1e-5 && view.target.z < view.position.z);
}

#[test]
fn cameras_far_from_zero_look_where_their_nodes_turn_them() {
    for far in [0.0, 1.0, 5e5, 1e8, 1e20] {
        let mut glb = Glb::default();
        glb.floats::<3>(&[[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        // Turned by 60 degrees about y.
        let bytes = glb.finish(&format!(
            r#""scenes":[{{"nodes":[0,1]}}],"cameras":[{{"type":"perspective","perspective":{{"yfov":1,"znear":0.1}}}}],
            "nodes":[{{"mesh":0}},{{"camera":0,"translation":[{far},-3,{far}],"rotation":[0,0.5,0,0.8660254]}}],
            "meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}}}}]}}]"#
        ));
        let view = parse(&bytes).unwrap().pose(None, &[0.0]).unwrap().camera.unwrap().keys[0];
        let [.., forward] = view.axes(1.0);
        assert!(forward.distance(Vec3::new(-0.8660254, 0.0, -0.5)) < 1e-5, "{forward} at {far}");
    }
}

#[test]
fn errors_name_the_place() {
    let file = |nodes: &str| {
        let mut glb = Glb::default();
        glb.floats::<3>(&[[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]);
        glb.accessor("SCALAR", 5121, 3, &[0, 1, 7], "");
        glb.finish(&format!(r#"{nodes},"meshes":[{{"primitives":[{{"attributes":{{"POSITION":0}},"indices":1}}]}}]"#))
    };
    let error = |bytes: &[u8]| match parse(bytes) {
        Err(error) => error.to_string(),
        Ok(_) => panic!("accepted"),
    };
    let said = error(&file(r#""nodes":[{"mesh":0}]"#));
    assert_eq!(said, "sample.glb: mesh 0, primitive 0: triangle 0 names vertex 7, but there are only 3");
    let mut ring = Glb::default();
    ring.floats::<1>(&[[0.0]]);
    assert!(error(&ring.finish(r#""nodes":[{"children":[1]},{"children":[0]}]"#)).contains("own ancestors"));
    assert!(error(&ring.finish(r#""nodes":[{"children":[2]},{"children":[2]},{}]"#)).contains("two parents"));
    assert!(error(b"glTF").contains("GLB header"));
    assert!(error(b"{}").starts_with("sample.glb: JSON: "));
    let unknown = parse(&arm()).unwrap().pose(Some("dance"), &[0.0]).unwrap_err().to_string();
    assert!(unknown.contains("dance") && unknown.contains("bend"), "{unknown}");
    let missing = Model::open(&["no/such.glb".into()]).unwrap_err().to_string();
    assert!(missing.starts_with("no/such.glb: "), "{missing}");
    assert!(Model::open(&["a.xyz".into()]).unwrap_err().to_string().contains("known are"));
}

const OBJ: &str = "# a square\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nf 1/1 2/1 3/1 4/1\n";

fn mseq() -> Vec<u8> {
    let mut bytes = b"MSEQ0001".to_vec();
    [3u32, 1, 2].iter().for_each(|x| bytes.extend(x.to_le_bytes()));
    bytes.extend(0.5f32.to_le_bytes());
    [0u32, 1, 2].iter().for_each(|x| bytes.extend(x.to_le_bytes()));
    for frame in 0..2 {
        for p in [[0.0, 0.0, frame as f32], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]] {
            p.iter().for_each(|x| bytes.extend(x.to_le_bytes()));
        }
    }
    bytes
}

fn ply(binary: bool) -> Vec<u8> {
    let format = if binary { "binary_little_endian" } else { "ascii" };
    let mut bytes = format!(
        "ply\nformat {format} 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\n\
         element face 1\nproperty list uchar int vertex_indices\nend_header\n"
    )
    .into_bytes();
    let corners = [[0.0f32, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]];
    if binary {
        for p in corners {
            bytes.extend(p.map(f32::to_le_bytes).concat());
            bytes.extend([255, 128, 0]);
        }
        bytes.push(4);
        (0i32..4).for_each(|i| bytes.extend(i.to_le_bytes()));
    } else {
        for [x, y, z] in corners {
            bytes.extend(format!("{x} {y} {z} 255 128 0\n").bytes());
        }
        bytes.extend(b"4 0 1 2 3\n");
    }
    bytes
}

#[test]
fn plain_formats_give_the_same_square() {
    let from_obj = obj::parse(OBJ.as_bytes(), Path::new("a.obj")).unwrap();
    for parts in [from_obj, ply::parse(&ply(false)).unwrap(), ply::parse(&ply(true)).unwrap()] {
        assert_eq!(parts[0].faces.triangles(&parts[0].positions).unwrap(), [[0, 1, 2], [0, 2, 3]]);
        assert_eq!(parts[0].positions[2], Vec3::new(1.0, 1.0, 0.0));
    }
    let colored = ply::parse(&ply(true)).unwrap();
    assert_eq!(colored[0].surface.vertex_colors[3], Vec3::new(1.0, crate::film::decode(128), 0.0));
    let sequence = mseq::parse(&mseq()).unwrap();
    assert_eq!(sequence.span(), Some((0.0, 0.5)));
    let z = sequence.pose(&[-1.0, 0.0, 0.125, 0.5, 3.0]).parts[0].keys.iter().map(|key| key[0].z).collect::<Vec<_>>();
    assert_eq!(z, [0.0, 0.0, 0.25, 1.0, 1.0]);
}

#[test]
fn broken_lines_of_an_obj_are_named() {
    for (wrong, line) in [
        (OBJ.replace("v 1 0 0", "v 1 x 0"), "line 3"),
        (OBJ.replace("v 0 1 0", "v 0 1"), "line 5"),
        (OBJ.replace("4/1", "9/1"), "line 7"),
        (OBJ.replace("4/1", "4/z"), "line 7"),
    ] {
        let error = obj::parse(wrong.as_bytes(), Path::new("a.obj")).err().unwrap().in_file(Path::new("a.obj"));
        assert!(error.to_string().starts_with(&format!("a.obj: {line}: ")), "{error}");
    }
}

#[test]
fn frames_of_other_topology_are_rejected() {
    let square = || obj::parse(OBJ.as_bytes(), Path::new("a.obj")).unwrap();
    let other = obj::parse(OBJ.replace("4/1", "").as_bytes(), Path::new("b.obj")).unwrap();
    let (a, b) = (Path::new("a.obj"), Path::new("b.obj"));
    assert!(Sequence::of_files(vec![(a, square()), (b, square())]).is_ok());
    let error = Sequence::of_files(vec![(a, square()), (b, other)]).err().unwrap().to_string();
    assert!(error.starts_with("b.obj: ") && error.contains("a.obj"), "{error}");
}

/// Reads and poses a file; a malformed one must return an error.
fn survive(kind: &str, bytes: &[u8]) -> Result<(), ReadError> {
    let file = PathBuf::from(format!("hostile.{kind}"));
    let sequence = |parts: Result<Vec<sequence::StillPart>, FormatError>| {
        Sequence::of_files(vec![(&file, parts.map_err(|e| e.in_file(&file))?)])
    };
    let model = match kind {
        "glb" | "gltf" => Model::Gltf(Box::new(GltfModel::parse(bytes, &file)?)),
        "mseq" => Model::Sequence(mseq::parse(bytes).map_err(|e| e.in_file(&file))?),
        "obj" => Model::Sequence(sequence(obj::parse(bytes, &file))?),
        _ => Model::Sequence(sequence(ply::parse(bytes))?),
    };
    model.span(None)?;
    let pose = model.pose(None, &[0.0, 0.3, 1e9])?;
    for part in pose.parts {
        assert!(part.keys.iter().flatten().all(|p| p.is_finite()));
        assert!(check_indices("", &part.indices, part.keys[0].len()).is_ok());
    }
    Ok(())
}

/// Truncates the file everywhere (or at `cuts` places) and flips bits, one or a few at a time.
fn torture(kind: &str, bytes: &[u8], cuts: usize, flips: u64) {
    survive(kind, bytes).unwrap_or_else(|e| panic!("the unharmed file: {e}"));
    let mut refused = 0;
    for cut in 0..cuts.min(bytes.len()) {
        let end = cut * bytes.len() / cuts.min(bytes.len());
        if let Err(error) = survive(kind, &bytes[..end]) {
            assert!(error.to_string().contains("hostile"), "{error}");
            refused += 1;
        }
    }
    assert!(refused > 0, "no cut of a .{kind} was noticed");
    for round in 0..flips {
        let mut bytes = bytes.to_vec();
        for flip in 0..=round % 3 {
            let random = crate::sampling::mix(round, flip);
            let at = (random >> 8) as usize % bytes.len();
            bytes[at] ^= if round % 2 == 0 { 1 << (random & 7) } else { random as u8 | 1 };
        }
        let _ = survive(kind, &bytes);
    }
}

#[test]
fn broken_files_are_errors_never_panics() {
    for (kind, bytes) in
        [("glb", arm()), ("obj", OBJ.into()), ("mseq", mseq()), ("ply", ply(false)), ("ply", ply(true))]
    {
        torture(kind, &bytes, usize::MAX, 6000);
    }
}

#[test]
fn declared_huge_sizes_allocate_nothing() {
    let ply = "ply\nformat ascii 1.0\nelement vertex 4000000000\nproperty float x\nend_header\n1\n";
    assert!(survive("ply", ply.as_bytes()).unwrap_err().to_string().contains("4000000000"));
    let mut seq = mseq();
    seq[8..20].copy_from_slice(&[255; 12]);
    assert!(survive("mseq", &seq).unwrap_err().to_string().contains("promises"));
    let json = r#"{"asset":{"version":"2.0"},"nodes":[{"mesh":0}],
        "meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],
        "accessors":[{"componentType":5126,"count":4000000000,"type":"VEC3","min":[0,0,0],"max":[0,0,0],
                      "sparse":{"count":1,"indices":{"bufferView":0,"componentType":5121},"values":{"bufferView":0}}}],
        "bufferViews":[{"buffer":0,"byteLength":16}],
        "buffers":[{"byteLength":16,"uri":"data:;base64,AAAAAAAAAAAAAAAAAAAAAA=="}]}"#;
    let said = survive("gltf", json.as_bytes()).unwrap_err().to_string();
    assert!(said.contains("memory"), "{said}");
}

/// Real files, if they are available: the folder `meshes/` in the one that MBKD_DATA names.
fn real(name: &str) -> Option<Vec<u8>> {
    let folder = std::env::var_os("MBKD_DATA")?;
    std::fs::read(Path::new(&folder).join("meshes").join(name)).ok()
}

#[test]
fn the_knight_moves_as_it_was_baked() {
    let (Some(glb), Some(baked)) = (real("kaykit_Knight.glb"), real("knight_running.mseq")) else { return };
    let (model, baked) = (parse(&glb).unwrap(), mseq::parse(&baked).unwrap());
    let times = baked.frame_times();
    let pose = model.pose(Some("Running_A"), &times).unwrap();
    let Part { indices, keys: frames, .. } = &baked.parts[0];
    for (frame, expected) in frames.iter().enumerate() {
        // The baked mesh has welded vertices, so corners of triangles are compared.
        let corners =
            |part: &Part| part.indices.iter().flatten().map(|&i| part.keys[frame][i as usize]).collect::<Vec<_>>();
        let found: Vec<Vec3> = pose.parts.iter().flat_map(corners).collect();
        let expected: Vec<Vec3> = indices.iter().flatten().map(|&i| expected[i as usize]).collect();
        assert_eq!(found.len(), expected.len());
        let far = found.iter().zip(expected).map(|(a, b)| a.distance(b)).fold(0.0, f32::max);
        assert!(far < 1e-6, "frame {frame}: {far}");
    }
}

#[test]
fn real_files_broken() {
    for (name, kind) in
        [("Fox.glb", "glb"), ("arnaud_run_f20.obj", "obj"), ("xrhand_left_relaxed_pinch_point.mseq", "mseq")]
    {
        if let Some(bytes) = real(name) {
            torture(kind, &bytes, 40, 60);
        }
    }
}
