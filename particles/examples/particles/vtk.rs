//! Particles as a legacy VTK file in binary, which ParaView opens: positions, velocity and density.

use mbkd::glam::Vec3;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

pub fn write(path: &Path, at: &[Vec3], velocity: &[Vec3], density: &[f32]) -> std::io::Result<()> {
    let mut file = BufWriter::new(File::create(path)?);
    let count = at.len();
    let vectors = |file: &mut BufWriter<File>, rows: &[Vec3]| {
        rows.iter().flat_map(|v| v.to_array()).try_for_each(|x| file.write_all(&x.to_be_bytes()))
    };
    write!(file, "# vtk DataFile Version 3.0\nparticles\nBINARY\nDATASET POLYDATA\nPOINTS {count} float\n")?;
    vectors(&mut file, at)?;
    write!(file, "\nVERTICES {count} {}\n", 2 * count)?;
    (0..count as u32).flat_map(|i| [1, i]).try_for_each(|i| file.write_all(&i.to_be_bytes()))?;
    write!(file, "\nPOINT_DATA {count}\nFIELD FieldData 2\nvelocity 3 {count} float\n")?;
    vectors(&mut file, velocity)?;
    write!(file, "\ndensity 1 {count} float\n")?;
    density.iter().try_for_each(|x| file.write_all(&x.to_be_bytes()))?;
    file.flush()
}
