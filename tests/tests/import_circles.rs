//! No two modules of a crate import from each other, whichever way round: what is read first can be understood first.
//!
//! A module and the modules in its folder are one room: a child may take from its parent, which is then no arrow. Every other `use`, and every path
//! that is written out, is an arrow from the module it stands in to the module where the name is defined, re-exports followed. Tests are left
//! out. This reads text, not Rust: it knows `use` trees and paths that begin with `crate`, `self`, `super` or a module's name.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

/// `["radio", "chain"]`; the crate's root is empty.
type Module = Vec<String>;

/// A crate's modules: source text without comments and tests, and the names that `use` brings in with what they stand for.
struct Crate {
    text: BTreeMap<Module, String>,
    names: BTreeMap<Module, BTreeMap<String, Module>>,
    tests: BTreeSet<Module>,
}

/// A `use` declaration's leaf: its path, the name it is given, whether it is exported.
struct Use {
    path: Vec<String>,
    name: String,
    exported: bool,
}

fn is_word(c: char) -> bool {
    c.is_alphanumeric() || c == '_'
}

/// Source files below a folder by module.
fn files(folder: &Path, module: &Module, out: &mut BTreeMap<Module, PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let stem = path.file_stem().unwrap().to_str().unwrap().to_owned();
        let mut own = module.clone();
        if path.is_dir() {
            own.push(stem);
            files(&path, &own, out);
        } else if path.extension().is_some_and(|e| e == "rs") && stem != "main" {
            if stem != "mod" && stem != "lib" {
                own.push(stem);
            }
            out.insert(own, path);
        }
    }
}

/// Without comments, and without the tests at the end.
fn code(text: &str) -> String {
    let lines: Vec<&str> = text.lines().map(|line| line.split("//").next().unwrap_or("")).collect();
    let mut end = lines.len();
    for (i, pair) in lines.windows(2).enumerate() {
        if pair[0].trim() == "#[cfg(test)]" && pair[1].starts_with("mod ") && pair[1].ends_with('{') {
            end = end.min(i);
        }
    }
    lines[..end].join("\n")
}

/// The leaves of a tree such as `a::{b, c::{self, d as e}}`.
fn leaves(tree: &str, prefix: &[String], exported: bool, out: &mut Vec<Use>) {
    let tree = tree.trim();
    if let Some(open) = tree.find('{') {
        let mut prefix = prefix.to_vec();
        prefix.extend(tree[..open].split("::").map(str::trim).filter(|p| !p.is_empty()).map(str::to_owned));
        let inner = &tree[open + 1..tree.rfind('}').unwrap()];
        let (mut depth, mut from) = (0, 0);
        for (i, c) in inner.char_indices().chain([(inner.len(), ',')]) {
            match c {
                '{' => depth += 1,
                '}' => depth -= 1,
                ',' if depth == 0 => {
                    if !inner[from..i].trim().is_empty() {
                        leaves(&inner[from..i], &prefix, exported, out);
                    }
                    from = i + 1;
                }
                _ => {}
            }
        }
        return;
    }
    let (path, alias) = tree.split_once(" as ").map_or((tree, None), |(path, alias)| (path, Some(alias.trim().to_owned())));
    let mut path: Vec<String> = prefix.iter().cloned().chain(path.split("::").map(|p| p.trim().to_owned())).collect();
    path.retain(|p| p != "*");
    if path.len() > 1 && path.last().is_some_and(|p| p == "self") {
        path.pop();
    }
    let name = alias.unwrap_or_else(|| path.last().cloned().unwrap_or_default());
    out.push(Use { path, name, exported });
}

/// Splits source text into its `use` declarations and the rest.
fn uses(text: &str) -> (Vec<Use>, String) {
    let (mut found, mut rest) = (Vec::new(), String::new());
    let mut statement: Option<(bool, String)> = None;
    for line in text.lines() {
        let trimmed = line.trim_start();
        if statement.is_none() {
            let begins = trimmed.strip_prefix("use ").map(|rest| (false, rest)).or_else(|| {
                let (visibility, rest) = trimmed.split_once(" use ")?;
                (visibility == "pub" || visibility.starts_with("pub(") && visibility.ends_with(')')).then_some((true, rest))
            });
            match begins {
                Some((exported, rest)) => statement = Some((exported, rest.to_owned())),
                None => {
                    rest.push_str(line);
                    rest.push('\n');
                }
            }
        } else if let Some((_, text)) = &mut statement {
            text.push(' ');
            text.push_str(trimmed);
        }
        if let Some((exported, text)) = statement.take_if(|(_, text)| text.contains(';')) {
            leaves(text.split(';').next().unwrap(), &[], exported, &mut found);
        }
    }
    (found, rest)
}

/// Paths that are written out, such as `crate::a::B` or `module::function`.
fn paths(text: &str) -> Vec<Vec<String>> {
    let mut out = Vec::new();
    let mut rest = text;
    while let Some(start) = rest.find(is_word) {
        let before = rest[..start].chars().next_back();
        rest = &rest[start..];
        let end = rest.find(|c| !is_word(c) && c != ':').unwrap_or(rest.len());
        let path: Vec<String> =
            rest[..end].split("::").map(|p| p.trim_matches(':').to_owned()).filter(|p| !p.is_empty()).collect();
        if path.len() > 1 && !matches!(before, Some(':' | '.')) {
            out.push(path);
        }
        rest = &rest[end..];
    }
    out
}

impl Crate {
    fn read(source: &Path) -> Self {
        let mut all = BTreeMap::new();
        files(source, &Module::new(), &mut all);
        let text: BTreeMap<Module, String> =
            all.into_iter().map(|(m, path)| (m, code(&std::fs::read_to_string(path).unwrap()))).collect();
        let mut this = Self { text, names: BTreeMap::new(), tests: BTreeSet::new() };
        for (module, text) in &this.text {
            let lines: Vec<&str> = text.lines().collect();
            for pair in lines.windows(2).filter(|pair| pair[0].trim() == "#[cfg(test)]") {
                if let Some((_, name)) = pair[1].trim_end_matches(';').split_once("mod ") {
                    this.tests.insert([module.as_slice(), &[name.to_owned()]].concat());
                }
            }
        }
        let modules: Vec<Module> = this.text.keys().cloned().collect();
        for module in modules {
            let (found, _) = uses(&this.text[&module]);
            let names = found.into_iter().filter_map(|u| Some((u.name, this.absolute(&module, &u.path)?))).collect();
            this.names.insert(module, names);
        }
        this
    }

    /// A path from the crate's root, if it is one of this crate's.
    fn absolute(&self, module: &Module, path: &[String]) -> Option<Module> {
        match path[0].as_str() {
            "crate" => Some(path[1..].to_vec()),
            "self" => Some([module.as_slice(), &path[1..]].concat()),
            "super" => {
                let up = path.iter().take_while(|p| *p == "super").count();
                Some([&module[..module.len().checked_sub(up)?], &path[up..]].concat())
            }
            first => {
                let child = [module.as_slice(), &[first.to_owned()]].concat();
                self.text.contains_key(&child).then(|| [module.as_slice(), path].concat())
            }
        }
    }

    /// The module in which what a path names is defined.
    fn home(&self, path: &Module, left: usize) -> Module {
        let modules = (0..=path.len()).rev().find(|&k| self.text.contains_key(&path[..k])).unwrap_or(0);
        let (module, item) = (path[..modules].to_vec(), &path[modules..]);
        match item.first().and_then(|name| self.names.get(&module)?.get(name)) {
            Some(target) if left > 0 && target != path => self.home(&[target.as_slice(), &item[1..]].concat(), left - 1),
            _ => module,
        }
    }

    /// Which module takes from which.
    fn arrows(&self) -> BTreeMap<Module, BTreeSet<Module>> {
        let mut out: BTreeMap<Module, BTreeSet<Module>> = BTreeMap::new();
        for (module, text) in &self.text {
            if self.tests.iter().any(|test| module.starts_with(test)) {
                continue;
            }
            let (found, rest) = uses(text);
            let taken = found.iter().filter(|u| !u.exported).filter_map(|u| self.absolute(module, &u.path));
            let written = paths(&rest).into_iter().filter_map(|path| {
                let named = self.names[module].get(&path[0]).map(|target| [target.as_slice(), &path[1..]].concat());
                named.or_else(|| self.absolute(module, &path))
            });
            for target in taken.chain(written) {
                let home = self.home(&target, 8);
                // A child takes from its parent: one room.
                if !module.starts_with(&home) && !self.tests.contains(&home) {
                    out.entry(module.clone()).or_default().insert(home);
                }
            }
        }
        out
    }

    /// Modules from which arrows lead back to themselves, each with the way.
    fn circles(&self) -> Vec<String> {
        let arrows = self.arrows();
        let mut out = Vec::new();
        for start in arrows.keys() {
            let mut ways: Vec<Vec<Module>> = vec![vec![start.clone()]];
            let mut seen = BTreeSet::new();
            while let Some(way) = ways.pop() {
                for next in arrows.get(way.last().unwrap()).into_iter().flatten() {
                    if next == start {
                        let names: Vec<String> = way.iter().chain([start]).map(|m| m.join("::")).collect();
                        out.push(names.join(" -> "));
                        ways.clear();
                        break;
                    }
                    if seen.insert(next.clone()) {
                        ways.push([way.as_slice(), std::slice::from_ref(next)].concat());
                    }
                }
            }
        }
        out
    }
}

#[test]
fn modules_import_one_way() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).parent().unwrap();
    for name in ["crates/scene", "crates/gpu", "crates/raytrace", "crates/corf", "crates/bench", "fuzz"] {
        let read = Crate::read(&root.join(name).join("src"));
        // That it reads what it should: a crate without arrows would have no circles either.
        assert!(
            read.text.len() < 10 || read.arrows().len() * 2 >= read.text.len(),
            "{name}: {} of {} modules import",
            read.arrows().len(),
            read.text.len()
        );
        let circles = read.circles();
        assert!(circles.is_empty(), "{name}: modules import each other in a circle:\n  {}", circles.join("\n  "));
    }
}

#[test]
fn circles_are_found() {
    let dir = tempfile::tempdir().unwrap();
    let write = |name: &str, text: &str| {
        let path = dir.path().join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    };
    write("lib.rs", "mod a;\nmod b;\npub mod c;\npub use a::Thing;\n");
    write("a.rs", "use crate::c::d::{Deep as Other, Unused};\npub struct Thing;\n");
    write("b.rs", "// use crate::c::Shallow;\n#[cfg(test)]\nmod tests {\n    use crate::c::Shallow;\n}\n");
    write("c/mod.rs", "pub mod d;\nuse d::Deep;\npub struct Shallow;\n");
    write("c/d.rs", "use super::Shallow;\npub struct Deep;\n");
    assert_eq!(Crate::read(dir.path()).circles(), Vec::<String>::new());
    // Through a re-export, and by a path that is written out.
    write("c/d.rs", "use super::Shallow;\npub struct Deep(crate::Thing);\n");
    assert_eq!(Crate::read(dir.path()).circles(), ["a -> c::d -> a", "c::d -> a -> c::d"]);
}
