//! `.mseq`: a baked sequence. Little-endian, no padding: 8 bytes "MSEQ0001", u32 vertices, u32 triangles, u32
//! frames, f32 seconds per frame, `u32 triangles[][3]`, `f32 positions[frames][vertices][3]`.

use super::sequence::Sequence;
use super::{FormatError, Part, check_indices, check_positions};
use crate::materials::Surface;
use mbkd::glam::Vec3;

const HEADER: usize = 24;

/// Reads the bytes of a file.
pub fn parse(bytes: &[u8]) -> Result<Sequence, FormatError> {
    let header = |what: &str| FormatError::new("header", what);
    let Some((head, body)) = bytes.split_at_checked(HEADER) else {
        return Err(header("the file ends inside it"));
    };
    let word = |at: usize| u32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
    if !head.starts_with(b"MSEQ0001") {
        return Err(header("does not begin with MSEQ0001"));
    }
    let [vertices, triangles, frames] = [8, 12, 16].map(|at| word(at) as usize);
    let seconds = f32::from_bits(word(20));
    if !(seconds > 0.0 && seconds.is_finite()) {
        return Err(header(&format!("{seconds} seconds per frame")));
    }
    if vertices == 0 || triangles == 0 || frames == 0 {
        return Err(header(&format!("{vertices} vertices, {triangles} triangles, {frames} frames: there is nothing")));
    }
    // In u128 no product of three 32-bit numbers overflows.
    let expected = 12 * (triangles as u128 + frames as u128 * vertices as u128);
    if body.len() as u128 != expected {
        let what = format!("it promises {expected} bytes after itself, the file has {}", body.len());
        return Err(header(&what));
    }
    let (index_bytes, position_bytes) = body.split_at(12 * triangles);
    let words = |triple: &[u8]| [0, 4, 8].map(|at| [triple[at], triple[at + 1], triple[at + 2], triple[at + 3]]);
    let indices: Vec<[u32; 3]> = index_bytes.chunks_exact(12).map(|c| words(c).map(u32::from_le_bytes)).collect();
    check_indices("triangles", &indices, vertices)?;
    let mut keys = Vec::with_capacity(frames);
    for (frame, chunk) in position_bytes.chunks_exact(12 * vertices).enumerate() {
        let positions: Vec<Vec3> =
            chunk.chunks_exact(12).map(|c| Vec3::from(words(c).map(f32::from_le_bytes))).collect();
        check_positions(&format!("frame {frame}"), &positions)?;
        keys.push(positions);
    }
    Ok(Sequence {
        parts: vec![Part { indices, keys, surface: Surface::plain(Vec3::new(0.62, 0.5, 0.42)) }],
        seconds_per_frame: f64::from(seconds),
        of_files: false,
    })
}
