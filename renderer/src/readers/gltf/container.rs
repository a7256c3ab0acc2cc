//! From bytes to a validated JSON document and its buffers: GLB chunks, data URIs, neighbouring files.

use super::super::{FormatError, read_file};
use gltf::Document;
use gltf::buffer::Source;
use gltf::json::validation::Checked;
use std::path::Path;

/// The document and all its buffers, each at least as long as declared.
pub fn open(bytes: &[u8], file: &Path) -> Result<(Document, Vec<Vec<u8>>), FormatError> {
    let (json, mut binary) = if bytes.starts_with(b"glTF") { chunks(bytes)? } else { (bytes, None) };
    let document = document(json)?;
    let mut buffers = Vec::new();
    for buffer in document.buffers() {
        let place = || format!("buffer {}", buffer.index());
        let data = match buffer.source() {
            Source::Bin => {
                binary.take().ok_or_else(|| FormatError::new(place(), "the file has no binary chunk for it"))?.to_vec()
            }
            Source::Uri(uri) => resource(uri, file).map_err(|what| FormatError::new(place(), what))?,
        };
        if data.len() < buffer.length() {
            return Err(FormatError::new(
                place(),
                format!("should have {} bytes, has {}", buffer.length(), data.len()),
            ));
        }
        buffers.push(data);
    }
    Ok((document, buffers))
}

/// The validated document.
fn document(json: &[u8]) -> Result<Document, FormatError> {
    let fail = |e: gltf::Error| FormatError::new("JSON", e.to_string());
    let other_version = |version: &str| {
        let what = format!("the file is glTF {version}; only 2.0 and its later minor versions are known");
        FormatError::new("asset", what)
    };
    let unchecked = gltf::Gltf::from_slice_without_validation(json).map_err(|error| {
        // Other versions have other structures, whose errors say nothing.
        let version = version_alone(json).filter(|version| !is_known(version));
        version.map_or_else(|| fail(error), |version| other_version(&version))
    })?;
    let root = unchecked.document.into_json();
    if !is_known(&root.asset.version) {
        return Err(other_version(&root.asset.version));
    }
    check_links(&root)?;
    Document::from_json(root).map_err(fail)
}

/// Whether a version is 2, with any minor version.
fn is_known(version: &str) -> bool {
    version.split('.').next() == Some("2")
}

/// The version in JSON of any structure.
fn version_alone(json: &[u8]) -> Option<String> {
    let root: gltf::json::Value = gltf::json::deserialize::from_slice(json).ok()?;
    Some(root.get("asset")?.get("version")?.as_str()?.to_owned())
}

/// Checks that gltf-json 1.4 omits and whose violation makes it panic later: indices of attributes (it uses that of the
/// positions before checking it) and targets of animation channels.
fn check_links(root: &gltf::json::Root) -> Result<(), FormatError> {
    let check = |place: String, what: &str, index: usize, count: usize| {
        let message = || format!("names {what} {index}, but there are only {count}");
        if index < count { Ok(()) } else { Err(FormatError::new(place, message())) }
    };
    for (m, mesh) in root.meshes.iter().enumerate() {
        for (p, primitive) in mesh.primitives.iter().enumerate() {
            for index in primitive.attributes.values() {
                check(format!("mesh {m}, primitive {p}"), "accessor", index.value(), root.accessors.len())?;
            }
        }
    }
    for (a, animation) in root.animations.iter().enumerate() {
        for (c, channel) in animation.channels.iter().enumerate() {
            let place = format!("animation {a}, channel {c}");
            check(place.clone(), "node", channel.target.node.value(), root.nodes.len())?;
            if channel.target.path == Checked::Invalid {
                return Err(FormatError::new(place, "animates something unknown"));
            }
        }
    }
    Ok(())
}

/// The JSON and binary chunks of a GLB file.
fn chunks(bytes: &[u8]) -> Result<(&[u8], Option<&[u8]>), FormatError> {
    let word = |at: usize| -> Option<u32> { Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?)) };
    let header = |what: &str| FormatError::new("GLB header", what);
    let (Some(version), Some(length)) = (word(4), word(8)) else {
        return Err(header("the file ends inside it"));
    };
    if version != 2 {
        return Err(header(&format!("version {version}; only 2 is known")));
    }
    if length as usize > bytes.len() {
        return Err(header(&format!("promises {length} bytes, the file has {}", bytes.len())));
    }
    let (mut at, mut json, mut binary) = (12, None, None);
    while at < length as usize {
        let place = format!("GLB chunk at byte {at}");
        let (Some(size), Some(kind)) = (word(at), word(at + 4)) else {
            return Err(FormatError::new(place, "the file ends inside its header"));
        };
        let end = (at + 8).saturating_add(size as usize);
        let Some(data) = bytes.get(at + 8..end) else {
            return Err(FormatError::new(place, format!("promises {size} bytes, the file ends before")));
        };
        match &kind.to_le_bytes() {
            b"JSON" if json.is_none() => json = Some(data),
            b"BIN\0" if binary.is_none() => binary = Some(data),
            _ => {} // The standard asks to skip unknown chunks.
        }
        at = end;
    }
    Ok((json.ok_or_else(|| header("there is no JSON chunk"))?, binary))
}

/// The contents of a URI: inline data, or a file next to `file`.
pub fn resource(uri: &str, file: &Path) -> Result<Vec<u8>, String> {
    if let Some(data) = uri.strip_prefix("data:") {
        let (kind, text) = data.split_once(',').ok_or("a data URI without a comma")?;
        if !kind.ends_with(";base64") {
            return Err("a data URI that is not base64".into());
        }
        return base64(text).ok_or_else(|| "a data URI with broken base64".into());
    }
    if uri.contains("://") {
        return Err(format!("`{uri}`: nothing is fetched from elsewhere"));
    }
    let name = percent_decoded(uri);
    let path = file.parent().unwrap_or(Path::new("")).join(name);
    read_file(&path).map_err(|e| e.to_string())
}

fn base64(text: &str) -> Option<Vec<u8>> {
    let text = text.trim_end_matches('=');
    let mut bytes = Vec::with_capacity(text.len() * 3 / 4);
    let (mut bits, mut count) = (0u32, 0);
    for c in text.bytes() {
        let value = match c {
            b'A'..=b'Z' => c - b'A',
            b'a'..=b'z' => c - b'a' + 26,
            b'0'..=b'9' => c - b'0' + 52,
            b'+' => 62,
            b'/' => 63,
            _ => return None,
        };
        bits = bits << 6 | u32::from(value);
        count += 6;
        if count >= 8 {
            count -= 8;
            bytes.push((bits >> count) as u8);
        }
    }
    Some(bytes)
}

fn percent_decoded(uri: &str) -> String {
    let uri = uri.as_bytes();
    let digit = |at: usize| char::from(*uri.get(at)?).to_digit(16);
    let (mut bytes, mut at) = (Vec::with_capacity(uri.len()), 0);
    while let Some(&byte) = uri.get(at) {
        match (byte, digit(at + 1), digit(at + 2)) {
            (b'%', Some(high), Some(low)) => {
                bytes.push((high * 16 + low) as u8);
                at += 3;
            }
            _ => {
                bytes.push(byte);
                at += 1;
            }
        }
    }
    String::from_utf8_lossy(&bytes).into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_encodings() {
        assert_eq!(base64("TWFu").as_deref(), Some(b"Man".as_slice()));
        assert_eq!(base64("TWE=").as_deref(), Some(b"Ma".as_slice()));
        assert_eq!(base64("T\u{fc}"), None);
        assert_eq!(percent_decoded("a%20b%zz%2"), "a b%zz%2");
    }
}
