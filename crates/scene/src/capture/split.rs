//! Which keyframes of an import train, and which are held out.

use super::names::{last, stem};
use super::options::SplitRule;
use super::{Lists, Shot};
use crate::config::SplitConfig;
use crate::dataset::StatedSplit;
use crate::words::counted;
use crate::{Error, Result, io};
use std::collections::BTreeSet;

/// The split of an import: a rule, and lists where keyframes were named.
pub(super) fn of(rule: Option<&SplitRule>, lists: Option<&Lists>, shots: &[Shot]) -> Result<(SplitConfig, Option<StatedSplit>)> {
    let usual = SplitConfig::default();
    let stated = match (rule, lists) {
        (Some(SplitRule::Every(every)), _) => {
            if *every < 2 && shots.len() > 1 {
                return Err(Error::invalid(
                    "--split",
                    format!("every {every} leaves nothing to train on"),
                    "give 2 or more (8 is usual)",
                ));
            }
            return Ok((SplitConfig { test_every: *every, ..usual }, None));
        }
        (Some(SplitRule::Listed(path)), _) => {
            let text = io::read_text(path)?;
            let lines: Vec<String> = text.lines().map(|l| l.trim().to_owned()).filter(|l| !l.is_empty()).collect();
            let test = indices(&lines, shots, &path.display().to_string(), true)?;
            StatedSplit { train: (0..shots.len()).filter(|i| !test.contains(i)).collect(), test: test.into_iter().collect() }
        }
        (None, Some(Lists { train, test, others, place })) => {
            let named = |names: &Vec<String>| indices(names, shots, place, false);
            let (train, test) = (train.as_ref().map(named).transpose()?, test.as_ref().map(named).transpose()?);
            let others = named(others)?;
            let rest = |named: &BTreeSet<usize>| (0..shots.len()).filter(|i| !named.contains(i) && !others.contains(i)).collect();
            let (train, test) = match (train, test) {
                (Some(train), Some(test)) => (train, test),
                (Some(train), None) => (train.clone(), rest(&train)),
                (None, Some(test)) => (rest(&test), test),
                (None, None) => return Ok((usual, None)),
            };
            if let Some(both) = train.intersection(&test).next() {
                let what = format!("{} is held out and trained with", shots[*both].name);
                return Err(Error::invalid(place, what, "mend the lists, or give --split"));
            }
            StatedSplit { train: train.into_iter().collect(), test: test.into_iter().collect() }
        }
        (None, None) => return Ok((usual, None)),
    };
    if stated.train.is_empty() || stated.test.is_empty() {
        let what = format!("{} to train with and {} held out", counted(stated.train.len(), "keyframe"), stated.test.len());
        return Err(Error::invalid("the split", what, "name some of each, or give --split N to hold out every N-th"));
    }
    Ok((usual, Some(stated)))
}

/// Indices of the shots that are named by stem or, where `or_indices` and none is, by index from 0.
fn indices(names: &[String], shots: &[Shot], place: &str, or_indices: bool) -> Result<BTreeSet<usize>> {
    let whole = |name: &str| shots.iter().position(|s| stem(&s.name) == stem(name));
    let part = |name: &str| {
        let mut found = shots.iter().enumerate().filter(|(_, s)| last(stem(&s.name)) == last(stem(name)));
        found.next().filter(|_| found.next().is_none()).map(|(i, _)| i)
    };
    let by_stem = |name: &String| whole(name).or_else(|| part(name));
    let by_index = |name: &String| name.parse::<usize>().ok().filter(|i| *i < shots.len());
    let found: Vec<Option<usize>> = names.iter().map(by_stem).collect();
    let found = if or_indices && found.iter().all(Option::is_none) { names.iter().map(by_index).collect() } else { found };
    let Some(unknown) = found.iter().position(Option::is_none) else { return Ok(found.into_iter().flatten().collect()) };
    Err(Error::invalid(
        place,
        format!("\"{}\" is no keyframe of the capture", names[unknown]),
        "name keyframes by the stem of their file, or all of them by index from 0",
    ))
}

#[cfg(test)]
mod tests {
    use super::super::lens::Lens;
    use super::*;
    use crate::{Pinhole, Rigid3};

    fn shots(names: &[&str]) -> Vec<Shot> {
        let lens = Lens::plain(Pinhole::from_horizontal_fov(8, 8, 90.0));
        let shot = |name: &&str| Shot {
            name: (*name).to_owned(),
            image: None,
            lens,
            world_from_camera: Rigid3::IDENTITY,
            depth: None,
            mask: None,
            time_s: None,
        };
        names.iter().map(shot).collect()
    }

    #[test]
    fn stems_come_before_indices_and_what_is_neither_is_named() {
        let shots = shots(&["cam/a.png", "cam/1.png", "cam/2.png", "cam/3.png"]);
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("test.txt");
        let listed = |text: &str| {
            std::fs::write(&path, text).unwrap();
            of(Some(&SplitRule::Listed(path.clone())), None, &shots).map(|(_, stated)| stated.unwrap().test)
        };
        assert_eq!(listed("1\n3.png\n").unwrap(), [1, 3]);
        assert_eq!(listed("cam/a\n").unwrap(), [0]);
        assert!(listed("1\n0\n").unwrap_err().to_string().contains("\"0\""), "1 is a stem here, so 0 is none");
        assert!(listed("").is_err() && listed("a\n1\n2\n3\n").is_err(), "nothing held out, nothing to train on");
        let digits = super::tests::shots(&["x.png", "y.png", "z.png"]);
        std::fs::write(&path, "2\n").unwrap();
        assert_eq!(of(Some(&SplitRule::Listed(path.clone())), None, &digits).unwrap().1.unwrap().train, [0, 1]);
        let lists = |train: &[&str], test: &[&str]| {
            let own = |names: &[&str]| names.iter().map(|n| (*n).to_owned()).collect();
            let lists =
                Lists { train: Some(own(train)), test: Some(own(test)), others: Vec::new(), place: "test_index.txt".into() };
            of(None, Some(&lists), &digits)
        };
        // What is on neither list takes no part.
        let stated = lists(&["x"], &["z.png"]).unwrap().1.unwrap();
        assert_eq!((stated.train, stated.test), (vec![0], vec![2]));
        assert!(lists(&["x", "z"], &["z"]).unwrap_err().to_string().contains("z.png is held out and trained with"));
        assert!(lists(&["x"], &["1"]).is_err(), "lists of others hold stems alone");
        // Of one list that is missing are all others.
        let one = |train: Option<&str>, test: Option<&str>, others: &[&str]| {
            let own = |name: &str| vec![name.to_owned()];
            let others = others.iter().map(|n| (*n).to_owned()).collect();
            let lists = Lists { train: train.map(own), test: test.map(own), others, place: "transforms.json".into() };
            let stated = of(None, Some(&lists), &digits).unwrap().1;
            stated.map(|stated| (stated.train, stated.test))
        };
        assert_eq!(one(None, Some("y"), &[]), Some((vec![0, 2], vec![1])));
        assert_eq!(one(None, Some("y"), &["z"]), Some((vec![0], vec![1])));
        assert_eq!(one(Some("y"), None, &[]), Some((vec![1], vec![0, 2])));
        assert_eq!(one(None, None, &[]), None);
        assert!(of(Some(&SplitRule::Every(1)), None, &digits).is_err());
        assert_eq!(of(Some(&SplitRule::Every(3)), None, &digits).unwrap().0.test_every, 3);
    }
}
