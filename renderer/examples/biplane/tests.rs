//! The file in the repository equals the output of this program, and the reader poses it as computed by hand.

use super::*;
use mbkd::glam::{DQuat, DVec3};
use mbkd_renderer::readers::Model;

#[test]
fn the_file_equals_the_output_of_the_program() {
    let (kept, made) = (std::fs::read(path()).unwrap(), biplane());
    assert!(
        kept == made,
        "the output of `cargo run --release --example biplane` has {} bytes, the file {}",
        made.len(),
        kept.len()
    );
    assert!(made.len() < 150_000, "{} bytes", made.len());
    let document = gltf::Gltf::from_slice(&made).unwrap().document;
    let joints: Vec<usize> = document.skins().map(|skin| skin.joints().count()).collect();
    assert_eq!(joints, [6, 9], "scarf and banner");
    assert!(document.materials().any(|material| material.emissive_strength() > Some(1.0)));
}

#[test]
fn the_reader_poses_it_as_computed_by_hand() {
    let model = Model::open(&[path()]).unwrap();
    assert_eq!(
        (model.clip_name(None).unwrap(), model.span(None).unwrap()),
        (Some("fly"), Some((0.0, f64::from(SECONDS))))
    );
    let times = [0.0, 0.25, 0.5, 1.0].map(|share| share * f64::from(SECONDS));
    let pose = model.pose(Some("fly"), &times).unwrap();
    assert!(pose.camera.is_some());
    let vertices = |key: usize| pose.parts.iter().flat_map(move |part| &part.keys[key]);
    let near = |key: usize, place: DVec3, within: f64| {
        let far = vertices(key).map(|p| p.as_dvec3().distance(place)).fold(f64::INFINITY, f64::min);
        assert!(far < within, "at {} s nothing is nearer to {place} than {far}", times[key]);
    };

    // The planet rotates by one of its sectors, and its meadows with it.
    let centre = planet::CENTRE.as_dvec3();
    let ground = pose.parts.iter().position(|part| part.surface.color.y == 0.36).unwrap();
    for (key, time) in times.into_iter().enumerate() {
        let turned = DQuat::from_rotation_z(std::f64::consts::TAU / planet::SECTORS as f64 * time / f64::from(SECONDS));
        for (p, first) in pose.parts[ground].keys[key].iter().zip(&pose.parts[ground].keys[0]) {
            let expected = centre + turned * (first.as_dvec3() - centre);
            assert!(p.as_dvec3().distance(expected) < 1e-5, "{p} is not {expected}");
        }
    }
    // The plane does not sway at the beginning, in the middle and at the end; its propeller has made 0, 5 and 10 turns.
    let (hub, blade) = (plane::HUB.as_dvec3(), f64::from(plane::BLADE));
    for key in [0, 2, 3] {
        near(key, hub + DVec3::Y * blade, 2e-3);
    }
    // After a quarter of the clip it has made 2.5, and the plane has rolled and moved ahead.
    let roll = DQuat::from_rotation_x(0.018 * std::f64::consts::TAU);
    near(1, roll * (hub - DVec3::Y * blade) + DVec3::X * 0.05, 2e-3);
    // The banner's free end is off its line, and back at the end of the clip.
    let banner = pose.parts.iter().rposition(|part| part.surface.color.x == 0.62).unwrap();
    let end = |key: usize| pose.parts[banner].keys[key][0];
    assert!(end(1).distance(end(0)) > 0.05 && end(3).distance(end(0)) < 1e-5, "{} {} {}", end(0), end(1), end(3));
}
