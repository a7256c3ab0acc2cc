//! The modules of `src` lie in layers and import downward only, and no files import each other in a circle, nor do the folders
//! of a layer.
//!
//! The order of the layers is the table in `docs/ARCHITECTURE.md`, top row lowest. Imports are the paths that
//! begin with `crate` or `super`, or with the name of a module beside them, outside of tests, comments and strings.
//! An item that a module re-exports from another (`pub use`) counts as an import of that other module by its users.

use std::collections::{BTreeMap, BTreeSet, VecDeque};
use std::path::Path;

/// A module, as its path from the root of the crate.
type Module = Vec<String>;

/// The modules of a crate, and what each imports.
struct Crate {
    imports: BTreeMap<Module, Vec<Import>>,
    layers: Vec<String>,
}

/// A path in the code.
struct Import {
    path: Vec<String>,
    /// The name under which it is re-exported (`pub use`), if it is.
    reexported_as: Option<String>,
}

#[test]
fn modules_import_downward_and_without_circles() {
    let mut files = Vec::new();
    read(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"), &mut Vec::new(), &mut files);
    let files: Vec<(&str, &str)> = files.iter().map(|(path, text)| (path.as_str(), text.as_str())).collect();
    let page = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/ARCHITECTURE.md");
    let it = Crate::new(&std::fs::read_to_string(page).unwrap(), &files);
    assert!(it.layers.len() > 10 && it.imports.len() > 50, "{} layers, {} files", it.layers.len(), it.imports.len());
    let imports: usize = it.imports.keys().map(|module| it.used_by(module).len()).sum();
    assert!(imports > 200, "only {imports} imports were understood");
    let violations = it.violations();
    assert!(violations.is_empty(), "{}", violations.join("\n"));
}

fn read(folder: &Path, names: &mut Vec<String>, files: &mut Vec<(String, String)>) {
    let entries = std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path());
    for path in entries.collect::<BTreeSet<_>>() {
        names.push(path.file_name().unwrap().to_str().unwrap().to_string());
        if path.is_dir() {
            read(&path, names, files);
        } else if names.last().is_some_and(|name| name.ends_with(".rs")) {
            files.push((names.join("/"), std::fs::read_to_string(&path).unwrap()));
        }
        names.pop();
    }
}

impl Crate {
    /// Parses the table of layers and files, given as paths below `src` and their text.
    fn new(table: &str, files: &[(&str, &str)]) -> Crate {
        let row = |line: &str| Some(line.strip_prefix("| `")?.split('`').next()?.to_string());
        let layers = table.lines().filter_map(row).collect();
        let module = |path: &str| {
            let path = path.trim_end_matches(".rs").trim_end_matches("/mod");
            path.split('/').filter(|name| *name != "lib").map(str::to_string).collect()
        };
        let code = files.iter().map(|(path, text)| (module(path), without_tests(&without_comments(text))));
        // Modules that are declared for tests only.
        let for_tests: BTreeSet<Module> = files
            .iter()
            .flat_map(|(path, text)| {
                let of: Module = module(path);
                let declared = text.split("#[cfg(test)]\nmod ").skip(1).filter_map(|rest| rest.split_once(';'));
                let names = declared.filter(|(name, _)| name.chars().all(|c| c.is_alphanumeric() || c == '_'));
                names.map(move |(name, _)| [of.clone(), vec![name.to_string()]].concat()).collect::<Vec<_>>()
            })
            .collect();
        let code: BTreeMap<Module, String> = code.filter(|(module, _)| !for_tests.contains(module)).collect();
        let imports = code.keys().map(|module| (module.clone(), imports(module, &code))).collect();
        Crate { imports, layers }
    }

    /// All violations.
    fn violations(&self) -> Vec<String> {
        let mut violations = Vec::new();
        let layer = |module: &[String]| self.layers.iter().position(|layer| *layer == module[0]);
        let below_root = self.imports.keys().filter(|module| !module.is_empty());
        for module in below_root.clone() {
            let Some(own) = layer(module) else {
                violations.push(format!("{} is in no layer of the table of layers", module.join("::")));
                continue;
            };
            for import in &self.imports[module] {
                // Both the module that defines the item, and the module at the begin of the path, which may only re-export it.
                let leads_to = self.definition(&import.path, 0).unwrap_or_default();
                let layers = [&leads_to, &import.path].map(|path| path.first().and_then(|_| layer(path)));
                if layers.into_iter().flatten().any(|of| of > own) {
                    let path = import.path.join("::");
                    violations.push(format!(
                        "{} uses {path}, which is in a later row of the table of layers",
                        module.join("::")
                    ));
                }
            }
        }
        let used: BTreeMap<Module, BTreeSet<Module>> = below_root.map(|m| (m.clone(), self.used_by(m))).collect();
        let mut reported = BTreeSet::new();
        for used in [&used, &of_folders(&used)] {
            for begin in used.keys() {
                if let Some(circle) = shortest_way_back(begin, used)
                    && reported.insert(circle.iter().cloned().collect::<BTreeSet<_>>())
                {
                    let names: Vec<String> = circle.iter().map(|module| module.join("::")).collect();
                    violations.push(format!("a circle of imports: {}", names.join(" -> ")));
                }
            }
        }
        violations
    }

    /// The modules that define the items that a module uses.
    fn used_by(&self, module: &Module) -> BTreeSet<Module> {
        let imports = self.imports[module].iter().filter(|import| import.reexported_as.is_none());
        let mut used: BTreeSet<Module> = imports.filter_map(|import| self.definition(&import.path, 0)).collect();
        used.remove(module);
        used.remove(&Vec::new());
        used
    }

    /// The module that defines the item at a path, followed through re-exports.
    fn definition(&self, path: &[String], followed: usize) -> Option<Module> {
        let known = (0..=path.len()).rev().find(|&n| self.imports.contains_key(&path[..n]))?;
        let module = path[..known].to_vec();
        let Some(name) = path.get(known) else { return Some(module) };
        let from = self.imports[&module].iter().find(|import| import.reexported_as.as_ref() == Some(name));
        match from {
            Some(from) if followed < 8 && from.path != path => {
                self.definition(&[&from.path[..], &path[known + 1..]].concat(), followed + 1)
            }
            _ => Some(module),
        }
    }
}

/// All paths in a module's code, from the root of the crate.
fn imports(module: &Module, code: &BTreeMap<Module, String>) -> Vec<Import> {
    let tokens = tokens(&code[module]);
    let mut imports = Vec::new();
    for (i, token) in tokens.iter().enumerate() {
        let begins = i.checked_sub(1).is_none_or(|before| tokens[before] != "::");
        let beside = [&module[..], std::slice::from_ref(token)].concat();
        let starts = match token.as_str() {
            "crate" | "super" => tokens.get(i + 1).is_some_and(|next| next == "::"),
            _ => tokens.get(i + 1).is_some_and(|next| next == "::") && code.contains_key(&beside),
        };
        if !begins || !starts {
            continue;
        }
        let reexported = i > 0 && tokens[i - 1] == "use" && is_public(&tokens[..i - 1]);
        for (path, name) in expand(&tokens[i..]) {
            let mut absolute = match path[0].as_str() {
                "crate" | "super" => Vec::new(),
                _ => module.clone(),
            };
            let ups = path.iter().take_while(|name| *name == "super").count();
            if ups > 0 {
                // `super` beyond the root can only be in a module within the file, where it means the file.
                absolute = module[..module.len().saturating_sub(ups)].to_vec();
            }
            let rest = path.iter().skip(ups).filter(|name| *name != "crate" && *name != "self");
            absolute.extend(rest.cloned());
            if !absolute.is_empty() {
                imports.push(Import { path: absolute, reexported_as: reexported.then_some(name) });
            }
        }
    }
    imports
}

/// Whether the tokens end with `pub` or `pub(...)`.
fn is_public(tokens: &[String]) -> bool {
    match tokens.last().map(String::as_str) {
        Some("pub") => true,
        Some(")") => tokens.iter().rposition(|t| t == "(").is_some_and(|open| open > 0 && tokens[open - 1] == "pub"),
        _ => false,
    }
}

/// The paths of a use tree like `a::{b, c::d as e}`, each with the name of its last segment.
fn expand(tokens: &[String]) -> Vec<(Vec<String>, String)> {
    fn tree(tokens: &[String], at: &mut usize, before: &[String], out: &mut Vec<(Vec<String>, String)>) {
        let mut path = before.to_vec();
        loop {
            match tokens.get(*at).map(String::as_str) {
                Some("{") => {
                    *at += 1;
                    while tokens.get(*at).is_some_and(|t| t != "}") {
                        tree(tokens, at, &path, out);
                        if tokens.get(*at).is_some_and(|t| t == ",") {
                            *at += 1;
                        }
                    }
                    *at += 1;
                    return;
                }
                Some(name) if name == "*" || is_name(name) => {
                    path.push(name.to_string());
                    *at += 1;
                }
                // A token that cannot continue a path, as in `Vec::<u32>`.
                _ => break,
            }
            if tokens.get(*at).is_none_or(|t| t != "::") {
                break;
            }
            *at += 1;
        }
        let mut name = path.last().cloned().unwrap_or_default();
        if tokens.get(*at).is_some_and(|t| t == "as") {
            name = tokens.get(*at + 1).cloned().unwrap_or_default();
            *at += 2;
        }
        if path.len() > before.len() {
            out.push((path, name));
        } else {
            // Not a path after all: skip the token, or this would not terminate.
            *at += 1;
        }
    }
    let mut out = Vec::new();
    tree(tokens, &mut 0, &[], &mut out);
    out
}

fn is_name(token: &str) -> bool {
    token.starts_with(|c: char| c.is_alphabetic() || c == '_')
}

/// Tokens: names, `::`, and every other character that is not whitespace.
fn tokens(code: &str) -> Vec<String> {
    let mut tokens: Vec<String> = Vec::new();
    let mut chars = code.chars().peekable();
    while let Some(c) = chars.next() {
        if c.is_alphanumeric() || c == '_' {
            let mut name = c.to_string();
            while let Some(c) = chars.next_if(|c| c.is_alphanumeric() || *c == '_') {
                name.push(c);
            }
            tokens.push(name);
        } else if c == ':' && chars.next_if_eq(&':').is_some() {
            tokens.push("::".to_string());
        } else if !c.is_whitespace() {
            tokens.push(c.to_string());
        }
    }
    tokens
}

/// The code without comments, and with all strings empty.
fn without_comments(text: &str) -> String {
    let mut code = String::new();
    let mut rest = text;
    while let Some(c) = rest.chars().next() {
        let end = |mark: &str| rest[mark.len()..].find(mark).map_or(rest.len(), |at| at + 2 * mark.len());
        let skip = if rest.starts_with("//") {
            rest.find('\n').unwrap_or(rest.len())
        } else if rest.starts_with("/*") {
            rest.find("*/").map_or(rest.len(), |at| at + 2)
        } else if rest.starts_with("r#\"") {
            rest.find("\"#").map_or(rest.len(), |at| at + 2)
        } else if rest.starts_with("'\"'") || rest.starts_with("'{'") || rest.starts_with("'}'") {
            3
        } else if c == '"' {
            let mut at = end("\"");
            // A quotation mark after an odd number of backslashes belongs to the string.
            while at < rest.len() && rest[..at - 1].chars().rev().take_while(|c| *c == '\\').count() % 2 == 1 {
                at = rest[at..].find('"').map_or(rest.len(), |more| at + more + 1);
            }
            at
        } else {
            code.push(c);
            rest = &rest[c.len_utf8()..];
            continue;
        };
        rest = &rest[skip..];
    }
    code
}

/// The code without items that are compiled for tests only.
fn without_tests(code: &str) -> String {
    let mut out = String::new();
    let mut rest = code;
    while let Some((before, behind)) = rest.split_once("#[cfg(test)]") {
        out.push_str(before);
        let mut depth = 0;
        let end = behind.find(|c| {
            depth += i32::from(c == '{') - i32::from(c == '}');
            depth == 0 && (c == '}' || c == ';')
        });
        rest = end.map_or("", |at| &behind[at + 1..]);
    }
    out + rest
}

/// What the files and folders directly below each layer import from each other.
fn of_folders(used: &BTreeMap<Module, BTreeSet<Module>>) -> BTreeMap<Module, BTreeSet<Module>> {
    let folder = |module: &Module| module[..module.len().min(2)].to_vec();
    let mut of_folders: BTreeMap<Module, BTreeSet<Module>> = BTreeMap::new();
    for (module, used) in used {
        let own = folder(module);
        let others: Vec<Module> = used.iter().map(folder).filter(|other| *other != own).collect();
        of_folders.entry(own).or_default().extend(others);
    }
    of_folders
}

/// The shortest circle through a module.
fn shortest_way_back(begin: &Module, used: &BTreeMap<Module, BTreeSet<Module>>) -> Option<Vec<Module>> {
    let mut came_from: BTreeMap<&Module, &Module> = BTreeMap::new();
    let mut waiting = VecDeque::from([begin]);
    while let Some(at) = waiting.pop_front() {
        for next in used.get(at).into_iter().flatten() {
            if next == begin {
                let mut circle = vec![begin.clone()];
                let mut back = at;
                while back != begin {
                    circle.insert(1, back.clone());
                    back = came_from[back];
                }
                return Some(circle);
            }
            if !came_from.contains_key(next) {
                came_from.insert(next, at);
                waiting.push_back(next);
            }
        }
    }
    None
}

/// The violations in made-up files in which `low` is below `high`.
fn wrong(files: &[(&str, &str)]) -> Vec<String> {
    let table = "| module | contents |\n|---|---|\n| `low` | this |\n| `high` | that |";
    let root = "mod high;\nmod low;\npub use high::High;";
    Crate::new(table, &[&[("lib.rs", root)], files].concat()).violations()
}

#[test]
fn an_import_from_above_is_found() {
    let high = ("high.rs", "use crate::low::Low;\npub struct High(Low);");
    assert_eq!(wrong(&[high, ("low.rs", "pub struct Low;")]), [""; 0]);
    for upward in [
        "use crate::high::High;",
        "use super::high::High;",
        "use crate::{high::{High}, other};",
        "fn f(_: crate::high::High) {}",
        "fn f() { let _: &'static str = \"\\\"\"; crate::high::High::f() }",
        "pub use crate::high::High;",
        "use crate::High;",
    ] {
        let found = wrong(&[("high.rs", "pub struct High;"), ("low.rs", upward)]);
        assert_eq!(found.len(), 1, "{upward}: {found:?}");
        assert!(found[0].starts_with("low uses ") && found[0].contains("High"), "{found:?}");
    }
}

#[test]
fn tests_comments_and_strings_may_say_anything() {
    for fine in [
        "// use crate::high::High;\n/* use crate::high::High; */\n/// [`crate::high`]\nfn f() {}",
        "fn f() -> &'static str { \"use crate::high::High;\" }",
        "#[cfg(test)]\nmod tests { use crate::high::High; fn f() { if true {} } }\nfn g() {}",
        "#[cfg(test)]\nuse crate::high::High;\nfn g() {}",
    ] {
        assert_eq!(wrong(&[("high.rs", "pub struct High;"), ("low.rs", fine)]), [""; 0], "{fine}");
    }
    let behind = "#[cfg(test)]\nmod tests { fn f() {} }\nuse crate::high::High;";
    assert_eq!(wrong(&[("high.rs", ""), ("low.rs", behind)]).len(), 1);
}

#[test]
fn circles_within_a_layer_are_found() {
    let facade = ("low/mod.rs", "mod a;\nmod b;\npub use a::A;\npub(crate) use b::{B as Bee};");
    let circle = ["a circle of imports: low::a -> low::b"];
    let a = ("low/a.rs", "use super::b::B;\npub struct A(B);");
    assert_eq!(wrong(&[facade, a, ("low/b.rs", "pub struct B;")]), [""; 0]);
    assert_eq!(wrong(&[facade, a, ("low/b.rs", "use super::a::A;\npub struct B;")]), circle);
    // Through a re-exporting module as well.
    assert_eq!(wrong(&[facade, a, ("low/b.rs", "use super::A;\npub struct B;")]), circle);
    let renamed = ("low/a.rs", "use crate::low::Bee;\npub struct A;");
    assert_eq!(wrong(&[facade, renamed, ("low/b.rs", "fn f(_: super::A) {}\npub struct B;")]), circle);
    // A circle of three.
    let three = [("low/a.rs", "use super::b::B;"), ("low/b.rs", "use super::c::C;"), ("low/c.rs", "use super::a::A;")];
    let found = wrong(&[&[("low/mod.rs", "mod a;\nmod b;\nmod c;")][..], &three].concat());
    assert_eq!(found, ["a circle of imports: low::a -> low::b -> low::c"]);
    // Folders, none of whose files import each other in a circle.
    let facade = ("low/mod.rs", "mod c;\nmod d;");
    let folders = [
        facade,
        ("low/c/mod.rs", "mod x;\nmod y;"),
        ("low/d/mod.rs", "mod x;\nmod y;"),
        ("low/c/x.rs", "use crate::low::d::x::X;"),
        ("low/d/y.rs", "use crate::low::c::y::Y;"),
    ];
    let files = [("low/c/y.rs", "pub struct Y;"), ("low/d/x.rs", "pub struct X;")];
    assert_eq!(wrong(&[&folders[..], &files].concat()), ["a circle of imports: low::c -> low::d"]);
    assert_eq!(wrong(&[&folders[..4], &files].concat()), [""; 0]);
    // A module may not import from submodules that use its own items.
    let own = ("low/mod.rs", "mod a;\npub struct Own(a::A);");
    let found = wrong(&[own, ("low/a.rs", "use super::Own;\npub struct A;")]);
    assert_eq!(found, ["a circle of imports: low -> low::a"]);
}

#[test]
fn a_module_without_a_layer_is_found() {
    assert_eq!(wrong(&[("new.rs", "")]), ["new is in no layer of the table of layers"]);
}
