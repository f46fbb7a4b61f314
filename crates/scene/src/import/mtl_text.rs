//! MTL files: statements to the numbers and maps of materials.

use super::notes::Notes;
use super::obj_text::{decode, numbers, split, statements, without_comment};
use crate::{Error, Result};
use std::collections::{BTreeMap, BTreeSet};

/// Kinds of unknown statements that are reported one by one.
const MAX_UNKNOWN: usize = 8;

/// A material of an MTL file: what its statements say, by keyword.
#[derive(Clone, Debug, Default)]
pub(super) struct MtlMaterial {
    pub name: String,
    /// `Kd`, `Ks`, `Ke`: linear RGB.
    pub colors: BTreeMap<&'static str, [f32; 3]>,
    /// `Ns`, `Ni`, `d`, `Tr`, `Pr`, `Pm`, `illum`.
    pub scalars: BTreeMap<&'static str, f32>,
    /// `map_Kd`, `map_Ke`, `map_d`.
    pub maps: BTreeMap<&'static str, MapArguments>,
    /// Lines of the statements; `newmtl` is that of the material itself.
    pub lines: BTreeMap<&'static str, usize>,
}

/// Reads an MTL file's bytes; `file` names it in messages.
///
/// # Errors
/// A statement that cannot be read; the message names its line.
pub(super) fn read(bytes: &[u8], file: &str, notes: &mut Notes) -> Result<Vec<MtlMaterial>> {
    let mut materials: Vec<MtlMaterial> = Vec::new();
    let mut unknown = BTreeSet::new();
    for (line, statement) in statements(&decode(bytes)) {
        let (keyword, rest) = split(&statement);
        let place = format!("{file}:{line}");
        let lower = keyword.to_ascii_lowercase();
        if lower == "newmtl" {
            if rest.is_empty() {
                return Err(Error::invalid(place, "`newmtl` without a name", "name the material, as the OBJ's usemtl does"));
            }
            let lines = BTreeMap::from([("newmtl", line)]);
            materials.push(MtlMaterial { name: rest.to_string(), lines, ..MtlMaterial::default() });
            continue;
        }
        let Some(material) = materials.last_mut() else {
            notes.note("statements before the first newmtl are of no material", place);
            continue;
        };
        match lower.as_str() {
            "kd" => material.color(line, "Kd", rest, &place, 1.0, notes)?,
            "ks" => material.color(line, "Ks", rest, &place, 1.0, notes)?,
            "ke" => material.color(line, "Ke", rest, &place, f32::MAX, notes)?,
            "ns" => material.scalar(line, "Ns", number(rest, &place)?),
            "ni" => material.scalar(line, "Ni", number(rest, &place)?),
            "d" => {
                let halo = rest.strip_prefix("-halo");
                if halo.is_some() {
                    notes.note("`d -halo` is taken as `d`: the same from all sides", &place);
                }
                material.scalar(line, "d", number(halo.unwrap_or(rest), &place)?);
            }
            "tr" => material.scalar(line, "Tr", number(rest, &place)?),
            "pr" => material.scalar(line, "Pr", number(rest, &place)?),
            "pm" => material.scalar(line, "Pm", number(rest, &place)?),
            "illum" => {
                let model = number(rest, &place)?;
                if !(0.0..=255.0).contains(&model) {
                    return Err(Error::invalid(place, format!("illum {model} is no illumination model"), "they go from 0 to 10"));
                }
                material.scalar(line, "illum", model.round());
            }
            "map_kd" => material.map(line, "map_Kd", rest, &place)?,
            "map_ke" => material.map(line, "map_Ke", rest, &place)?,
            "map_d" => material.map(line, "map_d", rest, &place)?,
            // Ambient light is an approximation that tracing light needs no more.
            "ka" | "map_ka" | "sharpness" | "map_aat" => {}
            "map_ks" | "map_ns" | "map_bump" | "bump" | "map_norm" | "norm" | "disp" | "map_disp" | "decal" | "refl"
            | "map_refl" | "map_tr" | "map_opacity" | "map_pr" | "map_pm" | "map_ps" | "map_ni" | "tf" | "ps" | "pc" | "pcr"
            | "aniso" | "anisor" => {
                // A filter that passes all or nothing says nothing that `d` does not.
                let plain = lower == "tf"
                    && numbers(rest, &place).is_ok_and(|v| v.iter().all(|x| *x == 1.0) || v.iter().all(|x| *x == 0.0));
                if !plain {
                    notes.note(format!("`{keyword}` is not read"), place);
                }
            }
            _ => {
                let keyword: String = keyword.chars().take(40).collect();
                if unknown.contains(&keyword) || unknown.len() < MAX_UNKNOWN {
                    notes.note(format!("`{keyword}` is no statement that is read"), place);
                    unknown.insert(keyword);
                } else {
                    notes.note("further statements are of kinds that are not read", place);
                }
            }
        }
    }
    Ok(materials)
}

/// The one number of a statement; what stands behind it does not count.
fn number(rest: &str, place: &str) -> Result<f32> {
    let word = without_comment(rest).split_whitespace().next().unwrap_or_default();
    numbers(word, place)?
        .first()
        .copied()
        .ok_or_else(|| Error::invalid(place, "a statement without its number", "repair this line, or export the model again"))
}

impl MtlMaterial {
    fn scalar(&mut self, line: usize, keyword: &'static str, value: f32) {
        self.scalars.insert(keyword, value);
        self.lines.insert(keyword, line);
    }

    /// Three numbers, or one for all three; `most` is the largest that means something.
    fn color(&mut self, line: usize, keyword: &'static str, rest: &str, place: &str, most: f32, notes: &mut Notes) -> Result<()> {
        let first = rest.split_whitespace().next().unwrap_or_default();
        if ["spectral", "xyz"].contains(&first.to_ascii_lowercase().as_str()) {
            notes.warn(format!("`{keyword} {first}` is not read; give red, green and blue"), place);
            return Ok(());
        }
        let [r, g, b] = match *numbers(rest, place)? {
            [grey] => [grey; 3],
            [r, g, b, ..] => [r, g, b],
            ref other => {
                return Err(Error::invalid(
                    place,
                    format!("`{keyword}` with {} numbers", other.len()),
                    "it has three, or one for a grey; repair this line, or export the model again",
                ));
            }
        };
        let color = [r, g, b].map(|v| {
            if !(0.0..=most).contains(&v) {
                notes.warn(format!("`{keyword}` is taken to the range of 0 to {most}"), place);
            }
            v.clamp(0.0, most)
        });
        self.colors.insert(keyword, color);
        self.lines.insert(keyword, line);
        Ok(())
    }

    fn map(&mut self, line: usize, keyword: &'static str, rest: &str, place: &str) -> Result<()> {
        // An empty map is none: some programs write one for every material.
        if rest.is_empty() {
            return Ok(());
        }
        let map = MapArguments::parse(rest).map_err(|what| {
            Error::invalid(place, format!("`{keyword}` {what}"), "repair this line, or export the model again")
        })?;
        self.maps.insert(keyword, map);
        self.lines.insert(keyword, line);
        Ok(())
    }
}

/// Parsed arguments of an MTL texture statement (`map_Kd` and its like): a file, and options before or behind it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct MapArguments {
    /// File name; spaces belong to it.
    pub name: String,
    /// `-s`: texture coordinates are multiplied by it.
    pub scale: [f32; 2],
    /// `-o`: added to the texture coordinates then.
    pub offset: [f32; 2],
    /// `-clamp on`: outside of `[0, 1]` the border's colour is seen instead of a repeat.
    pub clamp: bool,
    /// `-imfchan`: the channel that a scalar map is read from (r, g, b, m for alpha, l for luminance, z for depth).
    pub channel: Option<char>,
    /// Options that change what is seen and are not read.
    pub unread: Vec<&'static str>,
}

/// An option: its name and how many arguments it has at least and at most.
const OPTIONS: [(&str, usize, usize); 14] = [
    ("-s", 1, 3),
    ("-o", 1, 3),
    ("-t", 1, 3),
    ("-mm", 2, 2),
    ("-bm", 1, 1),
    ("-boost", 1, 1),
    ("-texres", 1, 1),
    ("-clamp", 1, 1),
    ("-cc", 1, 1),
    ("-blendu", 1, 1),
    ("-blendv", 1, 1),
    ("-imfchan", 1, 1),
    ("-type", 1, 1),
    ("-colorspace", 1, 1),
];

impl MapArguments {
    /// Reads a map's arguments.
    ///
    /// # Errors
    /// A description of the fault in them, as the end of a sentence.
    pub(super) fn parse(arguments: &str) -> std::result::Result<Self, String> {
        let mut out =
            Self { name: String::new(), scale: [1.0; 2], offset: [0.0; 2], clamp: false, channel: None, unread: Vec::new() };
        let option = |word: &str| OPTIONS.iter().find(|(name, ..)| word.eq_ignore_ascii_case(name)).copied();
        let mut rest = arguments.trim();
        while !rest.is_empty() {
            let (word, behind) = split(rest);
            match option(word) {
                Some((name, least, most)) => rest = out.option(name, least, most, behind)?,
                None if out.name.is_empty() => {
                    let mut end = rest.len();
                    let mut from = 0;
                    while let Some(gap) = rest[from..].find(char::is_whitespace) {
                        let next = from + gap + rest[from + gap..].find(|c: char| !c.is_whitespace()).unwrap_or(0);
                        if option(split(&rest[next..]).0).is_some() {
                            end = next;
                            break;
                        }
                        from = next;
                    }
                    out.name = rest[..end].trim().trim_matches('"').trim().to_string();
                    rest = &rest[end..];
                }
                None => return Err(format!("has `{word}` behind its file's name")),
            }
        }
        if out.name.is_empty() { Err("names no file".into()) } else { Ok(out) }
    }

    /// Takes an option's arguments off `rest` and returns what is behind them.
    fn option<'r>(
        &mut self,
        name: &'static str,
        least: usize,
        most: usize,
        rest: &'r str,
    ) -> std::result::Result<&'r str, String> {
        let (mut rest, mut words) = (rest, Vec::new());
        while words.len() < most && !rest.is_empty() {
            let (word, behind) = split(rest);
            // Beyond the least there are only numbers, and a file's name must be left where none has come.
            let number = word.parse::<f32>().is_ok();
            if words.len() >= least && (!number || (self.name.is_empty() && behind.is_empty())) {
                break;
            }
            words.push(word);
            rest = behind;
        }
        if words.len() < least {
            return Err(format!("has `{name}` without its argument"));
        }
        let on = words[0].eq_ignore_ascii_case("on");
        let numbers = || {
            let value =
                |w: &&str| w.parse::<f32>().ok().filter(|v| v.is_finite()).ok_or(format!("has `{name} {w}`, which is no number"));
            words.iter().map(value).collect::<std::result::Result<Vec<f32>, String>>()
        };
        match name {
            "-s" => self.scale.iter_mut().zip(numbers()?).for_each(|(slot, v)| *slot = v),
            "-o" => self.offset.iter_mut().zip(numbers()?).for_each(|(slot, v)| *slot = v),
            "-t" if numbers()?.iter().any(|v| *v != 0.0) => self.unread.push("-t"),
            "-mm" if numbers()? != [0.0, 1.0] => self.unread.push("-mm"),
            "-clamp" => self.clamp = on,
            "-cc" if on => self.unread.push("-cc"),
            "-type" => self.unread.push("-type"),
            "-imfchan" => self.channel = words[0].chars().next().map(|c| c.to_ascii_lowercase()),
            _ => {}
        }
        Ok(rest)
    }
}
