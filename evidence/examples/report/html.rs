//! The page: one file that needs no other, readable on a phone, light or dark as the reader has it.

use crate::page::{Item, Picture, Section, Table};
use std::fmt::Write;

const STYLE: &str = "
:root { color-scheme: light dark; --ink: #1b1b1f; --paper: #ffffff; --faint: #8a8a92; --line: #d8d8de; --yes: #00714f; --no: #b34700; }
@media (prefers-color-scheme: dark) {
  :root { --ink: #e6e6ea; --paper: #141418; --faint: #94949c; --line: #3a3a42; --yes: #38c79a; --no: #f0914a; } }
body { font: 16px/1.5 system-ui, sans-serif; color: var(--ink); background: var(--paper); max-width: 60rem; margin: 0 auto; padding: 0.5rem 1rem 4rem; }
h1 { font-size: 1.5rem; line-height: 1.25; } h2 { font-size: 1.25rem; margin-top: 3rem; }
figure { margin: 1.5rem 0; } figcaption { color: var(--faint); margin-bottom: 0.4rem; }
.wide { overflow-x: auto; } svg { width: 100%; height: auto; color: var(--ink); } img { max-width: 100%; height: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: 0.875rem; }
th, td { padding: 0.2rem 0.6rem; text-align: right; border-bottom: 1px solid var(--line); white-space: nowrap; }
th { white-space: normal; vertical-align: bottom; } th:first-child, td:first-child { text-align: left; }
.claim { border-left: 4px solid var(--yes); padding-left: 0.8rem; } .claim.not { border-color: var(--no); }
.claim b { color: var(--yes); } .claim.not b { color: var(--no); } dl { display: grid; grid-template-columns: max-content 1fr; gap: 0 1rem; }
dt { color: var(--faint); } dd { margin: 0; }
";

/// Writes the page of some sections. `facts` are what stands above them; `drawings` holds the SVG of each plot, in the order
/// of the plots.
pub fn page(facts: &[(&str, String)], sections: &[Section], drawings: &[String]) -> String {
    let mut out = String::new();
    let mut drawings = drawings.iter();
    let head = "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
        <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"><title>Run time against error</title>";
    let _ = writeln!(
        out,
        "{head}<style>{STYLE}</style></head><body>\n<h1>Structures for moving geometry: run time against error</h1>\n<dl>"
    );
    for (name, value) in facts {
        let _ = writeln!(out, "<dt>{}</dt><dd>{}</dd>", escaped(name), escaped(value));
    }
    out.push_str("</dl>\n<nav><ul>\n");
    for section in sections {
        let _ = writeln!(out, "<li><a href=\"#{}\">{}</a></li>", section.id, escaped(section.title));
    }
    out.push_str("</ul></nav>\n");
    summary(&mut out, sections);
    for section in sections {
        let _ = writeln!(out, "<h2 id=\"{}\">{}</h2>", section.id, escaped(section.title));
        for item in &section.items {
            match item {
                Item::Text(text) => _ = writeln!(out, "<p>{}</p>", escaped(text)),
                Item::Claim { text, holds } => {
                    let (class, verdict) = if *holds { ("claim", "Holds") } else { ("claim not", "Does not hold") };
                    let _ = writeln!(out, "<p class=\"{class}\"><b>{verdict}:</b> {}</p>", escaped(text));
                }
                Item::Table(it) => table(&mut out, it),
                Item::Plot(plot) => {
                    // The page's ink and paper in place of the drawing's.
                    let drawing = drawings.next().map(String::as_str).unwrap_or_default();
                    let drawing = drawing.replace("\"#000000\"", "\"currentColor\"").replace("\"#FFFFFF\"", "\"none\"");
                    let drawing = with_view_box(&drawing);
                    let caption = escaped(&plot.caption);
                    let _ = writeln!(out, "<figure><figcaption>{caption}</figcaption>{drawing}</figure>");
                }
                Item::Picture(picture) => image(&mut out, picture),
            }
        }
    }
    out.push_str("</body></html>\n");
    out
}

/// How many claims hold, and those that do not, each with a link to its section.
fn summary(out: &mut String, sections: &[Section]) {
    let claims = sections.iter().flat_map(|section| {
        section.items.iter().filter_map(move |item| match item {
            Item::Claim { text, holds } => Some((section.id, text, *holds)),
            _ => None,
        })
    });
    let (held, refuted): (Vec<_>, Vec<_>) = claims.partition(|(_, _, holds)| *holds);
    if held.is_empty() && refuted.is_empty() {
        return;
    }
    let all = held.len() + refuted.len();
    let _ = writeln!(out, "<p><b>{} of {all} checked claims hold in this run.</b>", held.len());
    if refuted.is_empty() {
        out.push_str("</p>\n");
        return;
    }
    out.push_str("Those that do not:</p>\n<ul>\n");
    for (id, text, _) in refuted {
        let _ = writeln!(out, "<li><a href=\"#{id}\">{}</a></li>", escaped(text));
    }
    out.push_str("</ul>\n");
}

/// A drawing that takes the width there is. (Its own width and height are those of its view box already.)
fn with_view_box(svg: &str) -> String {
    let Some(begin) = svg.find("<svg width=") else { return svg.to_string() };
    let Some(view) = svg[begin..].find("viewBox") else { return svg.to_string() };
    format!("<svg {}", &svg[begin + view..])
}

fn table(out: &mut String, table: &Table) {
    let _ =
        writeln!(out, "<figure><figcaption>{}</figcaption><div class=\"wide\"><table><tr>", escaped(&table.caption));
    for column in &table.columns {
        let _ = write!(out, "<th>{}</th>", escaped(column));
    }
    out.push_str("</tr>\n");
    for row in &table.rows {
        out.push_str("<tr>");
        for cell in row {
            let _ = write!(out, "<td>{}</td>", escaped(cell));
        }
        out.push_str("</tr>\n");
    }
    out.push_str("</table></div></figure>\n");
}

fn image(out: &mut String, picture: &Picture) {
    let (caption, data) = (escaped(&picture.caption), base64(&picture.png));
    let source = format!("<img alt=\"{caption}\" src=\"data:image/png;base64,{data}\">");
    let _ = writeln!(out, "<figure><figcaption>{caption}</figcaption>{source}</figure>");
}

fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

/// RFC 4648
fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for three in bytes.chunks(3) {
        let at = |i: usize| u32::from(three.get(i).copied().unwrap_or(0));
        let bits = at(0) << 16 | at(1) << 8 | at(2);
        for i in 0..4 {
            let digit = DIGITS[(bits >> (18 - 6 * i)) as usize & 63];
            out.push(if i <= three.len() { digit as char } else { '=' });
        }
    }
    out
}
