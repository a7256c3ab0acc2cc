//! Models from files: a file is read once, and can be posed at any times afterwards.
//!
//! Files are not trusted: every index and length is checked before use, sizes are limited before memory is allocated,
//! and errors name the file and the place.

mod gltf;
mod mseq;
mod obj;
mod picture;
mod ply;
mod polygons;
mod sequence;
#[cfg(test)]
mod tests;
#[cfg(test)]
mod text_tests;

use crate::materials::Surface;
use gltf::GltfModel;
use mbkd::glam::Vec3;
use mbkd_scenes::Camera;
#[cfg(test)]
pub use picture::decode;
use sequence::Sequence;
use std::fmt;
use std::path::{Path, PathBuf};

/// The greatest size of a file in bytes, and the limit of a model's size in numbers.
const LARGEST_FILE: u64 = 1 << 31;
/// The greatest number of vertices times keys of a model.
const MOST_VERTICES: usize = 1 << 27;

/// An error in a file, with its place.
#[derive(Debug)]
pub struct ReadError {
    /// The file.
    pub file: PathBuf,
    /// The place in it, such as `accessor 3`; may be empty.
    pub place: String,
    /// The error at that place.
    pub what: String,
}

impl fmt::Display for ReadError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: ", self.file.display())?;
        if !self.place.is_empty() {
            write!(f, "{}: ", self.place)?;
        }
        f.write_str(&self.what)
    }
}

/// An error at a place of a file; the caller adds the file's name.
#[derive(Debug)]
pub struct FormatError {
    place: String,
    what: String,
}

impl FormatError {
    fn new(place: impl Into<String>, what: impl Into<String>) -> FormatError {
        FormatError { place: place.into(), what: what.into() }
    }

    fn in_file(self, file: &Path) -> ReadError {
        ReadError { file: file.into(), place: self.place, what: self.what }
    }
}

/// Triangles with one surface, posed at some times.
#[derive(Debug)]
pub struct Part {
    /// Three vertex indices per triangle, all in range.
    pub indices: Vec<[u32; 3]>,
    /// Positions at each of the requested times, all finite and of equal number.
    pub keys: Vec<Vec<Vec3>>,
    /// Its surface.
    pub surface: Surface,
}

/// A model posed at some times.
#[derive(Debug)]
pub struct Pose {
    /// Its parts.
    pub parts: Vec<Part>,
    /// The file's own camera, with a view for each time, if it has one.
    pub camera: Option<Camera>,
}

/// A model that can be posed.
pub enum Model {
    /// glTF: a hierarchy with animations.
    Gltf(Box<GltfModel>),
    /// All other formats: the same triangles with positions at each frame.
    Sequence(Sequence),
}

impl fmt::Debug for Model {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Model::Gltf(_) => "glTF model",
            Model::Sequence(_) => "sequence",
        })
    }
}

impl Model {
    /// Reads one glTF, .mseq, .obj or .ply file, or several .obj or .ply files of equal topology as the frames of a
    /// sequence.
    pub fn open(files: &[PathBuf]) -> Result<Model, ReadError> {
        let Some(first) = files.first() else {
            return Err(FormatError::new("", "no file was given").in_file(Path::new("")));
        };
        let kind = extension(first);
        let alone = |what: &str| {
            let message = format!("{what} holds its own animation: give one file only");
            if files.len() > 1 { Err(FormatError::new("", message).in_file(first)) } else { Ok(()) }
        };
        match kind.as_str() {
            "glb" | "gltf" => {
                alone("glTF")?;
                let bytes = read_file(first)?;
                Ok(Model::Gltf(Box::new(GltfModel::parse(&bytes, first)?)))
            }
            "mseq" => {
                alone(".mseq")?;
                let sequence = mseq::parse(&read_file(first)?).map_err(|e| e.in_file(first))?;
                Ok(Model::Sequence(sequence))
            }
            "obj" | "ply" => {
                let mut frames = Vec::with_capacity(files.len());
                for file in files {
                    let bytes = read_file(file)?;
                    let parts = match extension(file).as_str() {
                        "obj" => obj::parse(&bytes, file),
                        "ply" => ply::parse(&bytes),
                        _ => Err(FormatError::new("", "the files of a sequence must be .obj or .ply")),
                    };
                    frames.push((file.as_path(), parts.map_err(|e| e.in_file(file))?));
                }
                Ok(Model::Sequence(Sequence::of_files(frames)?))
            }
            _ => Err(FormatError::new("", "known are .glb, .gltf, .obj, .ply and .mseq").in_file(first)),
        }
    }

    /// Poses the model at the given times, in seconds of a clip (its name or number; the first by default).
    pub fn pose(&self, clip: Option<&str>, times: &[f64]) -> Result<Pose, ReadError> {
        match self {
            Model::Gltf(model) => model.pose(clip, times),
            Model::Sequence(sequence) => Ok(sequence.pose(times)),
        }
    }

    /// The time span of a clip, in seconds; `None` if nothing moves.
    pub fn span(&self, clip: Option<&str>) -> Result<Option<(f64, f64)>, ReadError> {
        match self {
            Model::Gltf(model) => model.span(clip),
            Model::Sequence(sequence) => Ok(sequence.span()),
        }
    }

    /// Whether the model may have several animations.
    pub fn has_clips(&self) -> bool {
        matches!(self, Model::Gltf(_))
    }

    /// The name of a clip, if it has one.
    pub fn clip_name(&self, clip: Option<&str>) -> Result<Option<&str>, ReadError> {
        match self {
            Model::Gltf(model) => model.clip_name(clip),
            Model::Sequence(_) => Ok(None),
        }
    }

    /// The times of the frames of a sequence; one time for a model that is posed by clips.
    pub fn frame_times(&self) -> Vec<f64> {
        match self {
            Model::Gltf(_) => vec![0.0],
            Model::Sequence(sequence) => sequence.frame_times(),
        }
    }

    /// Whether the frames were given as one file each, and are the keys of a shutter.
    pub fn is_list_of_keys(&self) -> bool {
        matches!(self, Model::Sequence(sequence) if sequence.of_files)
    }
}

fn extension(file: &Path) -> String {
    file.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default()
}

/// A text without the byte order mark with which some editors begin UTF-8.
fn without_mark(bytes: &[u8]) -> &[u8] {
    bytes.strip_prefix(b"\xef\xbb\xbf").unwrap_or(bytes)
}

/// The bytes of a regular file of reasonable size.
fn read_file(file: &Path) -> Result<Vec<u8>, ReadError> {
    let fail = |what: String| FormatError::new("", what).in_file(file);
    let about = std::fs::metadata(file).map_err(|e| fail(e.to_string()))?;
    if !about.is_file() {
        return Err(fail("not a regular file".into()));
    }
    if about.len() > LARGEST_FILE {
        return Err(fail(format!("{} bytes are more than the {LARGEST_FILE} this reader takes", about.len())));
    }
    std::fs::read(file).map_err(|e| fail(e.to_string()))
}

/// Checks that all indices are below `vertices`; the error names the first triangle that is wrong.
fn check_indices(place: &str, indices: &[[u32; 3]], vertices: usize) -> Result<(), FormatError> {
    for (triangle, corners) in indices.iter().enumerate() {
        if let Some(index) = corners.iter().find(|&&i| i as usize >= vertices) {
            let what = format!("triangle {triangle} names vertex {index}, but there are only {vertices}");
            return Err(FormatError::new(place, what));
        }
    }
    Ok(())
}

/// Checks that all positions are finite and within the limits of a tree; the error names the first that is not.
fn check_positions(place: &str, positions: &[Vec3]) -> Result<(), FormatError> {
    let fine = |p: &Vec3| p.abs().max_element() <= mbkd::MAX_COORDINATE as f32 && p.is_finite();
    match positions.iter().position(|p| !fine(p)) {
        Some(vertex) => {
            Err(FormatError::new(place, format!("vertex {vertex} is at {}: not a usable position", positions[vertex])))
        }
        None => Ok(()),
    }
}
