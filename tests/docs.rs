//! What the documentation names exists: files, tests, and the targets of links. Lines of pages and comments are short.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

/// All files below a folder whose names end like this.
fn files(folder: &Path, endings: &[&str], found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() {
            if !name.starts_with('.') && name != "target" {
                files(&path, endings, found);
            }
        } else if endings.iter().any(|ending| name.ends_with(ending)) {
            found.push(path);
        }
    }
}

/// The code spans of a text. (Spans with spaces are commands and expressions.)
fn code_spans(text: &str) -> impl Iterator<Item = &str> {
    text.lines().flat_map(|line| line.split('`').skip(1).step_by(2)).filter(|span| !span.contains(' '))
}

fn comments(code: &str) -> String {
    let lines = code.lines().map(str::trim_start).filter(|line| line.starts_with("//"));
    lines.collect::<Vec<_>>().join("\n")
}

#[test]
fn files_and_tests_that_are_named_exist() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut paths = Vec::new();
    files(root, &[".rs", ".md"], &mut paths);
    let read = |path: &PathBuf| std::fs::read_to_string(path).unwrap();
    let (rust, pages): (Vec<_>, Vec<_>) = paths.iter().partition(|path| path.extension().is_some_and(|e| e == "rs"));
    let code: Vec<String> = rust.iter().map(|path| read(path)).collect();
    let functions: BTreeSet<&str> = code
        .iter()
        .flat_map(|text| text.split("fn ").skip(1))
        .filter_map(|rest| rest.split(|c: char| !c.is_alphanumeric() && c != '_').next())
        .collect();
    let texts = rust.iter().zip(code.iter().map(|text| comments(text)));
    let pages = pages.iter().map(|path| (path, read(path)));
    let (mut named, mut missing) = ([0, 0], Vec::new());
    for (path, text) in texts.chain(pages) {
        for span in code_spans(&text) {
            let is_file = span.ends_with(".rs") && span.chars().all(|c| c.is_alphanumeric() || "_/.-".contains(c));
            // Names of tests are sentences.
            let is_test = span.matches('_').count() >= 5 && span.chars().all(|c| c.is_ascii_lowercase() || c == '_');
            named[0] += usize::from(is_file);
            named[1] += usize::from(is_test);
            let exists = match (is_file, is_test) {
                (true, _) => rust.iter().any(|file| file.ends_with(span.trim_start_matches("../"))),
                (_, true) => functions.contains(span),
                _ => true,
            };
            if !exists {
                missing.push(format!("{}: {span}", path.strip_prefix(root).unwrap().display()));
            }
        }
    }
    assert!(missing.is_empty(), "{}", missing.join("\n"));
    assert!(named[0] > 100 && named[1] > 20, "few names were understood: {named:?}");
}

/// The lines of a page outside fenced code, with their numbers.
fn prose(page: &str) -> impl Iterator<Item = (usize, &str)> {
    let mut fenced = false;
    page.lines().enumerate().filter_map(move |(number, line)| {
        let fence = line.trim_start().starts_with("```");
        fenced ^= fence;
        (!fence && !fenced).then_some((number + 1, line))
    })
}

/// The anchors of a page: its headings, as GitHub names them.
fn anchors(page: &str) -> BTreeSet<String> {
    let headings = prose(page).filter(|(_, line)| line.starts_with('#'));
    let kept = |c: &char| c.is_alphanumeric() || " -_".contains(*c);
    let anchor =
        |line: &str| line.trim_start_matches('#').trim().to_lowercase().chars().filter(kept).collect::<String>();
    headings.map(|(_, line)| anchor(line).replace(' ', "-")).collect()
}

/// The longest line of a page or a comment.
const MOST: usize = 132;

#[test]
fn comments_are_no_wider_than_pages() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut paths = Vec::new();
    files(root, &[".rs"], &mut paths);
    let (mut wide, mut seen) = (Vec::new(), 0);
    for path in &paths {
        for (number, line) in std::fs::read_to_string(path).unwrap().lines().enumerate() {
            let Some(comment) = line.trim_start().strip_prefix("//") else { continue };
            seen += 1;
            let is_table = comment.trim_start_matches(['/', '!', ' ']).starts_with('|');
            if line.chars().count() > MOST && !is_table {
                wide.push(format!("{}:{}", path.strip_prefix(root).unwrap().display(), number + 1));
            }
        }
    }
    assert!(wide.is_empty(), "more than {MOST} characters: {}", wide.join(", "));
    assert!(seen > 10_000, "few comments were seen: {seen}");
}

#[test]
fn lines_of_pages_are_short_and_links_lead_somewhere() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut pages = Vec::new();
    files(root, &[".md"], &mut pages);
    let (mut wrong, mut links) = (Vec::new(), 0);
    for path in &pages {
        let page = std::fs::read_to_string(path).unwrap();
        let name = path.strip_prefix(root).unwrap().display();
        for (number, line) in prose(&page) {
            if line.chars().count() > MOST && !line.trim_start().starts_with('|') {
                wrong.push(format!("{name}:{number}: more than {MOST} characters"));
            }
            let targets = line.split("](").skip(1).filter_map(|rest| rest.split(')').next());
            for target in targets.filter(|target| !target.contains(':')) {
                let (file, anchor) = target.split_once('#').unwrap_or((target, ""));
                let to = if file.is_empty() { path.clone() } else { path.parent().unwrap().join(file) };
                let is_there = match std::fs::read_to_string(&to) {
                    Ok(there) => anchor.is_empty() || anchors(&there).contains(anchor),
                    Err(_) => anchor.is_empty() && to.exists(),
                };
                if !is_there {
                    wrong.push(format!("{name}:{number}: {target} does not exist"));
                }
                links += 1;
            }
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    assert!(links > 50, "few links were understood: {links}");
}
