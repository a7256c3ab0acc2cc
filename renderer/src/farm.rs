//! Rendering a picture on several machines: the requested part, and the commands that render all parts.

use crate::film::Film;
use crate::options::Options;
use crate::render::Job;
use std::path::PathBuf;

/// Whether only a part of the picture is requested.
pub fn is_part(options: &Options) -> bool {
    options.samples.is_some() || options.tile.is_some()
}

/// Whether the requested part exists.
pub fn check(options: &Options) -> Result<(), String> {
    if let (Some(frame), Some(frames)) = (options.frame, options.frames)
        && frame >= frames
    {
        return Err(format!("there is no frame {frame}: the {frames} frames are counted from 0"));
    }
    if let Some((_, end)) = options.samples
        && end > options.spp
    {
        return Err(format!("samples up to {end} were requested, but --spp is {}", options.spp));
    }
    if let Some(tile) = options.tile
        && (tile.x + tile.width > options.width as usize || tile.y + tile.height > options.height as usize)
    {
        return Err(format!("--tile reaches beyond the picture of {} x {} pixels", options.width, options.height));
    }
    if is_part(options) && options.frames.is_some() && options.frame.is_none() {
        return Err("parts of a sequence belong to one frame: add --frame".into());
    }
    Ok(())
}

/// An error if a part is incomplete: it would not merge.
pub fn whole_part(job: &Job, film: &Film) -> Result<(), String> {
    let whole = Job::new(job.width, job.height, job.samples);
    let is_part = job.taken != whole.taken || job.region != whole.region;
    match film.samples.iter().all(|&n| n == job.taken.1 - job.taken.0) {
        false if is_part => Err("interrupted: an unfinished part could not be merged, so none is written".into()),
        _ => Ok(()),
    }
}

/// All options that determine the picture, without those that select a part and those that do not change it. In ASCII, since
/// texts in EXR files are not Unicode.
pub fn about(options: &Options) -> String {
    let unimportant = Options { output: vec![], samples: None, tile: None, threads: None, ..options.clone() };
    format!("{unimportant:?}").escape_default().to_string()
}

/// The commands that do the work of a command line: one for each frame, or one for each of so many parts and their
/// merge.
pub fn commands(options: &Options, parts: u32, line: impl IntoIterator<Item = String>) -> Vec<String> {
    let line = words_but_lists(line);
    if let Some(frames) = options.frames {
        return (0..frames).map(|frame| joined(&line, &["--frame".into(), frame.to_string()])).collect();
    }
    let output = options.output.first().cloned().unwrap_or_else(|| PathBuf::from("motion_blur.png"));
    let stem = output.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    let name = |part: u32| output.with_file_name(format!("{stem}_part{part:03}.exr")).display().to_string();
    let parts = parts.min(options.spp);
    let at = |part: u32| u64::from(options.spp) * u64::from(part) / u64::from(parts);
    let without = without_outputs(&line);
    let part = |part: u32| {
        let samples = format!("{}..{}", at(part), at(part + 1));
        joined(&without, &["--samples".into(), samples, "-o".into(), name(part)])
    };
    let outputs = if options.output.is_empty() { vec![output.clone()] } else { options.output.clone() };
    let mut merge: Vec<String> = vec!["merge".into()];
    merge.extend((0..parts).map(name));
    merge.extend(outputs.iter().flat_map(|path| ["-o".into(), path.display().to_string()]));
    (0..parts).map(part).chain([joined(&line[..1], &merge)]).collect()
}

/// The words of a command line without `--list-commands`.
fn words_but_lists(line: impl IntoIterator<Item = String>) -> Vec<String> {
    let mut words = Vec::new();
    let mut line = line.into_iter().peekable();
    while let Some(word) = line.next() {
        if word == "--list-commands" {
            line.next_if(|next| next.parse::<u32>().is_ok());
        } else if !word.starts_with("--list-commands=") {
            words.push(word);
        }
    }
    words
}

/// The words of a command line without the files to write.
fn without_outputs(line: &[String]) -> Vec<String> {
    let mut words = Vec::new();
    let mut line = line.iter();
    while let Some(word) = line.next() {
        let glued = word.starts_with("--output=") || (word.starts_with("-o") && word.len() > 2);
        if word == "-o" || word == "--output" {
            line.next();
        } else if !glued {
            words.push(word.clone());
        }
    }
    words
}

/// Words quoted for a shell.
fn joined(words: &[String], more: &[String]) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./=,:+%@".contains(c);
    let quoted = |word: &String| match !word.is_empty() && word.chars().all(plain) {
        true => word.clone(),
        false => format!("'{}'", word.replace('\'', "'\\''")),
    };
    words.iter().chain(more).map(quoted).collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::Parser;

    fn listed(line: &[&str]) -> Vec<String> {
        let options = Options::try_parse_from(line).unwrap();
        commands(&options, options.list_commands.unwrap(), line.iter().map(|word| word.to_string()))
    }

    #[test]
    fn commands_are_command_lines() {
        let lines =
            listed(&["x", "--spp", "10", "--list-commands", "3", "-o", "it's.png", "--output=b.exr", "--seed", "2"]);
        assert_eq!(lines[0], "x --spp 10 --seed 2 --samples 0..3 -o 'it'\\''s_part000.exr'");
        assert_eq!(lines[2], "x --spp 10 --seed 2 --samples 6..10 -o 'it'\\''s_part002.exr'");
        let parts: Vec<String> = (0..3).map(|i| format!("'it'\\''s_part00{i}.exr'")).collect();
        assert_eq!(lines[3], format!("x merge {} -o 'it'\\''s.png' -o b.exr", parts.join(" ")));
        assert_eq!(lines.len(), 4);
        let lines = listed(&["x", "--frames", "3", "--list-commands"]);
        assert_eq!(lines, ["x --frames 3 --frame 0", "x --frames 3 --frame 1", "x --frames 3 --frame 2"]);
        assert_eq!(listed(&["x", "--spp", "2", "--list-commands=9"]).len(), 3, "no part without a sample");
    }

    #[test]
    fn parts_that_do_not_exist_are_errors() {
        let wrong = |line: &str| check(&Options::try_parse_from(line.split(' ')).unwrap()).unwrap_err();
        assert!(wrong("x --frames 3 --frame 3").contains("frame 3"));
        assert!(wrong("x --spp 8 --samples 4..9").contains("--spp is 8"));
        assert!(wrong("x --width 20 --tile 19,0,2,1").contains("20 x 540"));
        assert!(wrong("x --frames 3 --samples 0..1").contains("--frame"));
    }
}
