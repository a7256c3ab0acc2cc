//! The same triangles with positions at each of a number of frames.

use super::polygons::Polygons;
use super::{FormatError, Part, Pose, ReadError};
use crate::materials::Surface;
use mbkd::glam::Vec3;
use std::path::Path;

/// Faces of a file without animation.
pub struct StillPart {
    /// Vertex indices of its faces, all in range.
    pub faces: Polygons,
    /// Vertex positions.
    pub positions: Vec<Vec3>,
    /// Its surface.
    pub surface: Surface,
}

/// Parts with positions at every frame.
pub struct Sequence {
    /// Their keys are the frames.
    pub parts: Vec<Part>,
    /// Time between frames.
    pub seconds_per_frame: f64,
    /// Whether every frame was a file of its own.
    pub of_files: bool,
}

impl Sequence {
    /// Joins files of equal topology, one frame each, at 24 frames per second. All frames have the triangles into which the faces
    /// of the first are divided.
    pub fn of_files(frames: Vec<(&Path, Vec<StillPart>)>) -> Result<Sequence, ReadError> {
        let (mut parts, mut faces) = (Vec::<Part>::new(), Vec::new());
        let mut first_file = None;
        for (file, frame) in frames {
            let Some(first) = first_file else {
                for StillPart { faces: of_part, positions, surface } in frame {
                    let indices = of_part.triangles(&positions).map_err(|e| e.in_file(file))?;
                    faces.push(of_part);
                    parts.push(Part { indices, keys: vec![positions], surface });
                }
                first_file = Some(file);
                continue;
            };
            let differs = |what: String| {
                let what = format!("{what} than {}: frames must have equal topology", Path::display(first));
                FormatError::new("", what).in_file(file)
            };
            if frame.len() != parts.len() {
                return Err(differs(format!("has {} objects, other", frame.len())));
            }
            for ((part, Part { keys, .. }), faces) in frame.into_iter().zip(&mut parts).zip(&faces) {
                if part.positions.len() != keys[0].len() {
                    return Err(differs(format!("has {} vertices in an object, other", part.positions.len())));
                }
                if part.faces != *faces {
                    return Err(differs("has other faces".into()));
                }
                keys.push(part.positions);
            }
        }
        Ok(Sequence { parts, seconds_per_frame: 1.0 / 24.0, of_files: true })
    }

    fn frames(&self) -> usize {
        self.parts.first().map_or(0, |part| part.keys.len())
    }

    /// The time of each frame.
    pub fn frame_times(&self) -> Vec<f64> {
        (0..self.frames()).map(|frame| frame as f64 * self.seconds_per_frame).collect()
    }

    /// From the first frame to the last, in seconds.
    pub fn span(&self) -> Option<(f64, f64)> {
        let last = self.frames().checked_sub(1).filter(|&last| last > 0)?;
        Some((0.0, last as f64 * self.seconds_per_frame))
    }

    /// Interpolates linearly between frames; clamped to the first and the last frame.
    pub fn pose(&self, times: &[f64]) -> Pose {
        let last = self.frames().saturating_sub(1);
        let at = |keys: &[Vec<Vec3>], time: f64| -> Vec<Vec3> {
            let frame = (time / self.seconds_per_frame).clamp(0.0, last as f64);
            // Division may put a frame's own time off by a rounding error.
            let frame = if (frame - frame.round()).abs() < 1e-9 { frame.round() } else { frame };
            let segment = (frame as usize).min(last.saturating_sub(1));
            let s = (frame - segment as f64) as f32;
            let (a, b) = (&keys[segment], &keys[(segment + 1).min(last)]);
            // Exact at a frame's own time.
            a.iter().zip(b).map(|(a, b)| if s == 1.0 { *b } else { *a + (*b - *a) * s }).collect()
        };
        let parts = self.parts.iter().map(|part| Part {
            indices: part.indices.clone(),
            keys: times.iter().map(|&time| at(&part.keys, time)).collect(),
            surface: part.surface.clone(),
        });
        Pose { parts: parts.collect(), camera: None }
    }
}
