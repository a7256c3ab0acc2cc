//! Text files as other programs write them: faces of many corners, byte order marks, continued lines, short numbers, other
//! versions.

use super::*;

/// The parts of a sequence of OBJ files.
fn sequence_of(files: &[String]) -> Result<Vec<Part>, ReadError> {
    let names: Vec<PathBuf> = (0..files.len()).map(|i| format!("{i}.obj").into()).collect();
    let mut frames = Vec::new();
    for (file, name) in files.iter().zip(&names) {
        frames.push((name.as_path(), obj::parse(file.as_bytes(), name).map_err(|e| e.in_file(name))?));
    }
    Ok(Sequence::of_files(frames)?.parts)
}

fn obj_part(text: &str) -> Part {
    sequence_of(&[text.into()]).unwrap().remove(0)
}

fn error_of(text: &str) -> String {
    sequence_of(&[text.into()]).unwrap_err().to_string()
}

/// Twice the area of a part's triangles.
fn area(part: &Part, key: usize) -> f32 {
    let at = |i: u32| part.keys[key][i as usize];
    part.indices.iter().map(|&[a, b, c]| (at(b) - at(a)).cross(at(c) - at(a)).length()).sum()
}

/// A face with a reflex corner, and an L whose first corner does not see all of it.
const DART: &str = "v 0 4 0\nv -4 -2 0\nv 0 0 0\nv 4 -2 0\n";
const ELL: &str = "v 1 2 0\nv 0 2 0\nv 0 0 0\nv 2 0 0\nv 2 1 0\nv 1 1 0\n";

#[test]
fn concave_faces_of_obj_and_ply_are_not_fans() {
    for (corners, face, expected) in [(DART, "f 2 3 4 1", 32.0), (DART, "f 1 2 3 4", 32.0), (ELL, "f 1 2 3 4 5 6", 6.0)]
    {
        let part = obj_part(&format!("{corners}{face}\n"));
        assert_eq!((area(&part, 0), part.indices.len()), (expected, corners.lines().count() - 2));
        // Triangles, faces and further triangles of one object.
        let mixed = obj_part(&format!("{corners}f 1 2 3\n{face}\nf 1 2 3\n"));
        // Vertices are numbered as they are first used.
        let places = |part: &Part| -> Vec<[Vec3; 3]> {
            part.indices.iter().map(|triangle| triangle.map(|i| part.keys[0][i as usize])).collect()
        };
        let (mixed, n) = (places(&mixed), part.indices.len());
        assert_eq!((&mixed[1..=n], mixed.len()), (&places(&part)[..], n + 2));
        assert_eq!(mixed[0], mixed[n + 1]);
    }
    let ply = format!(
        "ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\nproperty float z\n\
         element face 2\nproperty list uchar int vertex_indices\nend_header\n{}6 0 1 2 3 4 5\n2 0 1\n",
        ELL.replace("v ", "")
    );
    let parts = ply::parse(ply.as_bytes()).unwrap();
    let part = Sequence::of_files(vec![(Path::new("a.ply"), parts)]).unwrap().parts.remove(0);
    assert_eq!((area(&part, 0), part.indices.len()), (6.0, 4));
}

#[test]
fn all_frames_have_the_triangles_of_the_first() {
    // The reflex corner moves to the other side: alone, the second frame would be divided otherwise.
    let frames = [format!("{DART}f 2 3 4 1\n"), format!("{}f 2 3 4 1\n", DART.replace("v 0 0 0", "v 0 -5 0"))];
    let alone = obj_part(&frames[1]);
    let part = sequence_of(&frames).unwrap().remove(0);
    assert_ne!(part.indices, alone.indices);
    assert_eq!(part.indices, obj_part(&frames[0]).indices);
    assert_eq!((part.keys.len(), area(&part, 0)), (2, 32.0));
    // The same corners in other faces are another topology.
    let square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";
    let frames = [format!("{square}f 1 2 3 4\n"), format!("{square}f 1 2 3\nf 1 3 4\n")];
    let error = sequence_of(&frames).unwrap_err().to_string();
    assert!(error.starts_with("1.obj: has other faces than 0.obj"), "{error}");
}

#[test]
fn a_byte_order_mark_is_skipped() {
    let text = "\u{feff}v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
    assert_eq!(obj_part(text).keys[0], [Vec3::ZERO, Vec3::X, Vec3::Y]);
    assert!(error_of(&text.replace("f 1 2 3", "f 1 2 4")).starts_with("0.obj: line 4: "));
    let ply = "\u{feff}ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
               element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n";
    assert_eq!(ply::parse(ply.as_bytes()).unwrap()[0].positions, [Vec3::ZERO, Vec3::X, Vec3::Y]);
}

#[test]
fn continued_lines_are_joined_and_keep_their_numbers() {
    let text = "# from C:\\models\\\nv 0 \\\n 0 0\nv 1 0\\\r\n 0\r\nv 1 1 0\nv 0 1 0\nf 1 2 \\ \n 3 \\\n 4\nf 1 2 4\n";
    let part = obj_part(text);
    assert_eq!(part.indices, [[0, 1, 2], [0, 2, 3], [0, 1, 3]]);
    assert_eq!(part.keys[0][..2], [Vec3::ZERO, Vec3::X]);
    let cases = [("f 1 2 4", "f 1 2 9", 11), (" 3 \\", " x \\", 8), ("v 0 1 0", "v 0 1", 7), ("v 0 \\", "v w \\", 2)];
    for (from, to, line) in cases {
        let error = error_of(&text.replace(from, to));
        assert!(error.starts_with(&format!("0.obj: line {line}: ")), "{error}");
    }
    assert_eq!(obj_part("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3 \\").indices, [[0, 1, 2]], "at the end of the file");
}

#[test]
fn lines_and_points_of_obj_are_no_faces() {
    let square = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";
    let part = obj_part(&format!("{square}l 1 2 3 4\nl 1 2\np 1 2 3\nf 1 2 3\nl 1 2 \\\n 3 4\nl\n"));
    assert_eq!(part.indices, [[0, 1, 2]]);
    assert!(error_of(&format!("{square}l 1 2 3 4\n")).contains("no triangles"));
    assert!(error_of(&format!("{square}f 1 2 3\nf\n")).contains("a face has no corners"));
}

#[test]
fn some_vertices_of_obj_may_have_colours() {
    let text = "v 0 0 0\nv 1 0 0 0.25 0.5 0.75\nv 1 1 \\\n 0\nv 0 1 0 1 0 0\nf 4 2 3\nf 1 2 3\n";
    let part = obj_part(text);
    let colors: Vec<_> = part.keys[0].iter().copied().zip(part.surface.vertex_colors).collect();
    let expected = [
        (Vec3::Y, Vec3::X),
        (Vec3::X, Vec3::new(0.25, 0.5, 0.75)),
        (Vec3::new(1.0, 1.0, 0.0), Vec3::ONE),
        (Vec3::ZERO, Vec3::ONE),
    ];
    assert_eq!(colors, expected);
    assert!(obj_part(&format!("{DART}f 1 2 3 4\n")).surface.vertex_colors.is_empty());
    assert!(error_of(&text.replace("f 1 2 3", "f 1 2 9")).starts_with("0.obj: line 7: "));
}

#[test]
fn colours_of_a_material_file_may_be_of_one_number_or_of_another_kind() {
    let folder = std::env::temp_dir().join(format!("mbkd-materials-{}", std::process::id()));
    std::fs::create_dir_all(&folder).unwrap();
    let color = |line: &str| {
        let materials = format!("newmtl a\nKa\nKs 0.5 0.5\n{line}\nmap_Kd caf\u{e9}.png\n");
        // As other programs write names: not in UTF-8.
        std::fs::write(folder.join("a.mtl"), materials.chars().map(|c| c as u8).collect::<Vec<_>>()).unwrap();
        let text = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n";
        obj::parse(text.as_bytes(), &folder.join("a.obj")).unwrap()[0].surface.color
    };
    let other = color("");
    for (line, expected) in [
        ("Kd 0.25 0.5 0.75", Vec3::new(0.25, 0.5, 0.75)),
        ("  Kd 0.25 0.5 0.75 1\r", Vec3::new(0.25, 0.5, 0.75)),
        ("Kd 0.25", Vec3::splat(0.25)),
        ("Kd", other),
        ("Kd 0.25 0.5", other),
        ("Kd spectral a.rfl 2", other),
    ] {
        assert_eq!(color(line), expected, "{line}");
    }
    std::fs::remove_dir_all(&folder).unwrap();
}

#[test]
fn numbers_of_ply_may_lack_digits_on_one_side() {
    let ply = |row: &str| {
        format!(
            "ply\nformat ascii 1.0\ncomment from . to 5. and .5\nelement vertex 3\nproperty float x\nproperty double y\n\
             property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
             0 0 0\n1 0 0\n{row}\n3 0 1 2\n"
        )
    };
    for (row, expected) in [
        (".5 -.25 +.125", [0.5, -0.25, 0.125]),
        ("5. -2. .5e1", [5.0, -2.0, 5.0]),
        ("5.e-1 0.75 1e1", [0.5, 0.75, 10.0]),
    ] {
        assert_eq!(ply::parse(ply(row).as_bytes()).unwrap()[0].positions[2].to_array(), expected, "{row}");
    }
    for row in [". 0 0", "-. 0 0", "1.2.3 0 0", "1 0"] {
        let error = ply::parse(ply(row).as_bytes()).err().unwrap();
        assert!(error.place == "body" && error.what.contains("Line 13"), "{row}: {error:?}");
    }
}

#[test]
fn indices_of_ply_are_reported_as_they_are() {
    for (kind, index) in [("char", "-1"), ("short", "-300"), ("int", "-1"), ("int", "3"), ("uint", "4294967295")] {
        let text = format!(
            "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n\
             element face 2\nproperty list uchar {kind} vertex_indices\nend_header\n\
             0 0 0\n1 0 0\n0 1 0\n3 0 1 2\n3 0 1 {index}\n"
        );
        let error = ply::parse(text.as_bytes()).err().unwrap().in_file(Path::new("a.ply")).to_string();
        assert_eq!(error, format!("a.ply: face 1: names vertex {index}, but there are only 3"));
    }
}

#[test]
fn other_versions_of_gltf_are_refused() {
    let error = |json: &str| {
        let result = GltfModel::parse(json.as_bytes(), Path::new("a.gltf"));
        result.err().map(|error| error.to_string())
    };
    let empty = |version: &str| format!(r#"{{"asset":{{"version":"{version}"}}}}"#);
    assert_eq!((error(&empty("2.0")), error(&empty("2.1"))), (None, None));
    for version in ["1.0", "3.0", "20.0", ""] {
        let said = error(&empty(version)).unwrap();
        assert!(said.starts_with(&format!("a.gltf: asset: the file is glTF {version}; only 2.0")), "{said}");
    }
    // Files of version 1 have names where those of 2 have lists.
    let old = r#"{"asset":{"version":"1.0"},"meshes":{"a":{"primitives":[]}},"nodes":{"b":{"meshes":["a"]}}}"#;
    assert!(error(old).unwrap().contains("glTF 1.0"));
    assert!(error(&old.replace("1.0", "2.0")).unwrap().starts_with("a.gltf: JSON: "));
}
