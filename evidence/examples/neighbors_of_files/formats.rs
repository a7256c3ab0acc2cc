//! Small readers of particle files: Houdini's BGEO (version 5, as particle simulators write it), legacy binary
//! VTK, and a plain table of columns (`.pset`). What they read is a table; other attributes are skipped.
//!
//! `.pset`: "PSET0001", u32 points, u32 frames, u32 columns, 16 bytes of name per column, f32 rows; all
//! little-endian. BGEO and VTK are big-endian.

use std::io::Read;
use std::path::Path;

/// Rows of named columns, one table per frame.
#[derive(Debug)]
pub struct Table {
    pub names: Vec<String>,
    pub frames: Vec<Vec<Vec<f32>>>,
}

const PLACE: [&str; 3] = ["x", "y", "z"];
const VELOCITY: [&str; 3] = ["vx", "vy", "vz"];

impl Table {
    /// Reads a file by its extension; nothing for other extensions. An error names what is wrong.
    pub fn open(path: &Path) -> Result<Option<Table>, String> {
        let parse = match path.extension().and_then(|e| e.to_str()) {
            Some("pset") => Table::pset,
            Some("bgeo") => Table::bgeo,
            Some("vtk") => Table::vtk,
            _ => return Ok(None),
        };
        let bytes = std::fs::read(path).map_err(|e| format!("{}: {e}", path.display()))?;
        parse(&bytes).map(Some).map_err(|e| format!("{}: {e}", path.display()))
    }

    /// The plain table.
    pub fn pset(bytes: &[u8]) -> Result<Table, String> {
        let mut from = Bytes(bytes);
        if from.take(8)? != b"PSET0001" {
            return Err("not a point set".into());
        }
        let mut u32 = || Ok::<_, String>(u32::from_le_bytes(from.array()?) as usize);
        let (points, frames, columns) = (u32()?, u32()?, u32()?);
        if points == 0 || frames == 0 || columns == 0 {
            return Err("no points, frames or columns".into());
        }
        let names = (0..columns)
            .map(|_| Ok(String::from_utf8_lossy(from.take(16)?).trim_end_matches('\0').to_string()))
            .collect::<Result<_, String>>()?;
        let bytes = points.checked_mul(frames).and_then(|n| n.checked_mul(4 * columns)).ok_or("too large")?;
        if from.0.len() != bytes {
            return Err(format!("{} bytes of values where {bytes} belong", from.0.len()));
        }
        let mut row = || (0..columns).map(|_| from.array().map(f32::from_le_bytes)).collect::<Result<Vec<f32>, _>>();
        let mut frame = || (0..points).map(|_| row()).collect::<Result<Vec<_>, _>>();
        let frames = (0..frames).map(|_| frame()).collect::<Result<Vec<_>, _>>()?;
        Ok(Table { names, frames })
    }

    /// BGEO, compressed or not: positions, and velocities where there are any.
    pub fn bgeo(bytes: &[u8]) -> Result<Table, String> {
        let mut unpacked = Vec::new();
        let bytes = if bytes.starts_with(&[0x1f, 0x8b]) {
            let size = flate2::read::GzDecoder::new(bytes).take(1 << 32).read_to_end(&mut unpacked);
            size.map_err(|e| format!("not gzip: {e}"))?;
            &unpacked
        } else {
            bytes
        };
        let mut from = Bytes(bytes);
        if from.take(5)? != b"BgeoV" || from.u32()? != 5 {
            return Err("not a BGEO file of version 5".into());
        }
        let points = from.u32()?;
        from.take(3 * 4)?;
        let attributes = from.u32()?;
        from.take(3 * 4)?;
        // Words of a point: four of place, then those of the attributes.
        let (mut words, mut velocity) = (4usize, None);
        for _ in 0..attributes {
            let length = u16::from_be_bytes(from.array()?);
            let name = from.take(length.into())?;
            let size = usize::from(u16::from_be_bytes(from.array()?));
            match (from.u32()?, size, name) {
                (0 | 1 | 5, 3, b"v" | b"velocity") => velocity = Some(words),
                (0 | 1 | 5, ..) => {}
                (kind, ..) => return Err(format!("attributes of kind {kind} are not read")),
            }
            from.take(4 * size)?;
            words += size;
        }
        let row = |_| {
            let values = from.floats(words)?;
            let of = |begin: usize| values[begin..begin + 3].to_vec();
            Ok([of(0), velocity.map(of).unwrap_or_default()].concat())
        };
        let rows = (0..points).map(row).collect::<Result<Vec<_>, String>>()?;
        Ok(Table { names: names(velocity.is_some()), frames: vec![rows] })
    }

    /// Legacy VTK in binary: points, and a field "velocity" where there is one.
    pub fn vtk(bytes: &[u8]) -> Result<Table, String> {
        if !bytes.starts_with(b"# vtk DataFile") {
            return Err("not a VTK file".into());
        }
        let (head, body) = behind(bytes, b"\nPOINTS ").ok_or("no POINTS")?;
        if behind(head, b"\nBINARY").is_none() {
            return Err("only binary files are read".into());
        }
        let (line, body) = behind(body, b"\n").ok_or("ends behind POINTS")?;
        let line = String::from_utf8_lossy(line);
        let count = match line.split_whitespace().collect::<Vec<_>>()[..] {
            [count, "float"] => count.parse::<usize>().map_err(|e| format!("POINTS {line}: {e}"))?,
            _ => return Err(format!("POINTS {line}: a count and float are read")),
        };
        let mut from = Bytes(body);
        let vectors = |from: &mut Bytes| (0..count).map(|_| from.floats(3)).collect::<Result<Vec<_>, _>>();
        let mut rows = vectors(&mut from)?;
        let velocity = behind(from.0, format!("velocity 3 {count} float\n").as_bytes());
        if velocity.is_none() {
            skip_fields(from.0)?;
        }
        if let Some((_, values)) = velocity {
            for (row, more) in rows.iter_mut().zip(vectors(&mut Bytes(values))?) {
                row.extend(more);
            }
        }
        Ok(Table { names: names(velocity.is_some()), frames: vec![rows] })
    }
}

/// Whether what follows the points is whole: nothing, a section that is not read, or all fields that are promised.
fn skip_fields(rest: &[u8]) -> Result<(), String> {
    let line = |from: &mut Bytes| {
        let (line, rest) = behind(from.0, b"\n").ok_or("the file ends inside a line")?;
        from.0 = rest;
        Ok::<_, String>(String::from_utf8_lossy(line).split_whitespace().map(String::from).collect::<Vec<_>>())
    };
    let mut from = Bytes(rest.trim_ascii_start());
    if from.0.is_empty() || line(&mut from)?.first().is_none_or(|word| word != "POINT_DATA") {
        return Ok(());
    }
    let header = line(&mut from)?;
    let ["FIELD", _, count] = header.iter().map(String::as_str).collect::<Vec<_>>()[..] else { return Ok(()) };
    for _ in 0..count.parse::<u32>().map_err(|e| format!("FIELD: {e}"))? {
        from.0 = from.0.trim_ascii_start();
        let field = line(&mut from)?;
        let number = |at: usize| field.get(at).and_then(|word| word.parse::<usize>().ok()).ok_or("a broken field");
        let size = match field.get(3).map(String::as_str) {
            Some("double" | "long" | "vtktypeint64") => 8,
            Some("float" | "int" | "unsigned_int") => 4,
            Some("short" | "unsigned_short") => 2,
            Some("char" | "unsigned_char") => 1,
            _ => return Err("a field of unknown type".into()),
        };
        from.take(number(1)?.saturating_mul(number(2)?).saturating_mul(size))?;
    }
    Ok(())
}

fn names(velocity: bool) -> Vec<String> {
    PLACE.iter().chain(if velocity { &VELOCITY[..] } else { &[] }).map(|n| n.to_string()).collect()
}

/// What comes before and after the first occurrence of `mark`.
fn behind<'a>(bytes: &'a [u8], mark: &[u8]) -> Option<(&'a [u8], &'a [u8])> {
    let at = bytes.windows(mark.len()).position(|w| w == mark)?;
    Some((&bytes[..at], &bytes[at + mark.len()..]))
}

/// What is left to be read.
struct Bytes<'a>(&'a [u8]);

impl<'a> Bytes<'a> {
    fn take(&mut self, count: usize) -> Result<&'a [u8], String> {
        let (taken, rest) = self.0.split_at_checked(count).ok_or("the file ends too early")?;
        self.0 = rest;
        Ok(taken)
    }
    fn array<const N: usize>(&mut self) -> Result<[u8; N], String> {
        Ok(self.take(N)?.try_into().expect("as many as taken"))
    }
    fn u32(&mut self) -> Result<u32, String> {
        Ok(u32::from_be_bytes(self.array()?))
    }
    fn floats(&mut self, count: usize) -> Result<Vec<f32>, String> {
        (0..count).map(|_| self.array().map(f32::from_be_bytes)).collect()
    }
}
