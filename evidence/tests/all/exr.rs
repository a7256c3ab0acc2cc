//! The renderer's EXR files are what the exr crate reads back.

#[path = "../../../renderer/src/exr.rs"]
#[allow(dead_code)] // parts of pictures, and reading them
mod writer;

use exr::prelude::*;
use mbkd::glam::Vec3;

#[test]
fn pictures_come_back_to_the_bit() {
    let (width, height) = (7, 5);
    let pixels: Vec<Vec3> =
        (0..width * height).map(|i| Vec3::new(i as f32, 1.0 / (i + 1) as f32, -1e-20 * i as f32)).collect();
    let path = std::env::temp_dir().join(format!("mbkd_exr_{}.exr", std::process::id()));
    std::fs::write(&path, writer::picture(width, height, &pixels)).unwrap();
    let read = read_first_rgba_layer_from_file(
        &path,
        |size, _| (size.width(), vec![Vec3::ZERO; size.area()]),
        |(across, read): &mut (usize, Vec<Vec3>), at, (r, g, b, _): (f32, f32, f32, f32)| {
            read[at.y() * *across + at.x()] = Vec3::new(r, g, b);
        },
    );
    std::fs::remove_file(&path).unwrap();
    let (across, read) = read.unwrap().layer_data.channel_data.pixels;
    assert_eq!((across, read), (width, pixels));
}
