//! Changes to inputs: of bits, bytes, numbers, words and lines.

use corf_scene::Rng;

/// Largest input, bytes.
const MAX_BYTES: usize = 1 << 15;
/// Numbers as text that parsers stumble over.
const NUMBERS: [&str; 30] = [
    "0",
    "-0",
    "1",
    "-1",
    "2",
    "3",
    "255",
    "256",
    "65535",
    "65536",
    "2147483647",
    "2147483648",
    "-2147483648",
    "4294967295",
    "4294967296",
    "9223372036854775807",
    "9223372036854775808",
    "18446744073709551615",
    "1e38",
    "1e39",
    "-1e300",
    "1e308",
    "1e309",
    "1e-320",
    "nan",
    "inf",
    "-inf",
    "0.5",
    "1e9",
    "100000000",
];
/// Numbers as bytes that parsers stumble over.
const WORDS: [u64; 14] =
    [0, 1, 2, 0x7f, 0x80, 0xff, 0x7fff, 0x8000, 0xffff, 0x7fff_ffff, 0x8000_0000, 0xffff_ffff, 0x7ff8_0000_0000_0000, u64::MAX];

/// The bytes of input `number` of a target named `name` under `seed`: a corpus file as it is for the first numbers, a changed one for others.
pub fn input(name: &str, corpus: &[Vec<u8>], seed: u64, number: u64) -> Vec<u8> {
    if let Some(file) = usize::try_from(number).ok().and_then(|n| corpus.get(n)) {
        return file.clone();
    }
    let key = name.bytes().fold(0xcbf2_9ce4_8422_2325_u64, |h, b| (h ^ u64::from(b)).wrapping_mul(0x100_0000_01b3));
    let mut draw = Draw(Rng::keyed(seed, key, number));
    let mut bytes = draw.one_of(corpus).cloned().unwrap_or_default();
    // One change as often as two, two as often as four or more.
    let mut changes = 1;
    while changes < 32 && draw.below(2) == 0 {
        changes += 1;
    }
    for _ in 0..changes {
        change(&mut bytes, corpus, &mut draw);
        bytes.truncate(MAX_BYTES);
    }
    bytes
}

/// Random choices.
struct Draw(Rng);

impl Draw {
    /// A number below `n`, or 0 where `n` is 0.
    fn below(&mut self, n: usize) -> usize {
        ((f64::from(self.0.uniform()) * n as f64) as usize).min(n.saturating_sub(1))
    }

    fn byte(&mut self) -> u8 {
        self.below(256) as u8
    }

    fn one_of<'t, T>(&mut self, all: &'t [T]) -> Option<&'t T> {
        all.get(self.below(all.len()))
    }

    /// A stretch of `0..length`, short ones more often.
    fn stretch(&mut self, length: usize) -> std::ops::Range<usize> {
        let start = self.below(length);
        let most = 1usize << self.below(10);
        start..(start + 1 + self.below(most)).min(length)
    }
}

/// Stretches of letters, digits and signs, as words and numbers are made of.
fn words(bytes: &[u8]) -> Vec<std::ops::Range<usize>> {
    let part = |b: &u8| b.is_ascii_alphanumeric() || matches!(b, b'.' | b'-' | b'+' | b'_');
    let mut all = Vec::new();
    let mut at = 0;
    while at < bytes.len() {
        let length = bytes[at..].iter().take_while(|b| part(b)).count();
        if length > 0 {
            all.push(at..at + length);
        }
        at += length.max(1);
    }
    all
}

fn change(bytes: &mut Vec<u8>, corpus: &[Vec<u8>], draw: &mut Draw) {
    if bytes.is_empty() {
        bytes.push(draw.byte());
        return;
    }
    let text = bytes.iter().all(|b| (9..127).contains(b));
    // Half of what changes a text changes it as one.
    match draw.below(if text { 20 } else { 13 }) {
        0 => {
            let at = draw.below(bytes.len());
            bytes[at] ^= 1 << draw.below(8);
        }
        1 => {
            let at = draw.below(bytes.len());
            bytes[at] = draw.byte();
        }
        2 => {
            let at = draw.below(bytes.len() + 1);
            let more: Vec<u8> = (0..1 + draw.below(8)).map(|_| draw.byte()).collect();
            bytes.splice(at..at, more);
        }
        3 => {
            let gone = draw.stretch(bytes.len());
            bytes.drain(gone);
        }
        4 => {
            let copy = bytes[draw.stretch(bytes.len())].to_vec();
            let at = draw.below(bytes.len() + 1);
            bytes.splice(at..at, copy);
        }
        5 => bytes.truncate(draw.below(bytes.len())),
        6 => {
            let other = draw.one_of(corpus).cloned().unwrap_or_default();
            let from = draw.below(other.len() + 1);
            bytes.truncate(draw.below(bytes.len() + 1));
            bytes.extend_from_slice(&other[from..]);
        }
        7 => {
            let other = draw.one_of(corpus).cloned().unwrap_or_default();
            let piece = other[draw.stretch(other.len())].to_vec();
            let at = draw.below(bytes.len() + 1);
            bytes.splice(at..at, piece);
        }
        8..=10 => {
            let (width, at) = (1 << draw.below(4), draw.below(bytes.len()));
            let word = draw.one_of(&WORDS).copied().unwrap_or(0).wrapping_add(draw.below(3) as u64).wrapping_sub(1);
            let (little, end) = (draw.below(2) == 0, (at + width).min(bytes.len()));
            let written = if little { word.to_le_bytes()[..width].to_vec() } else { word.to_be_bytes()[8 - width..].to_vec() };
            bytes.splice(at..end, written);
        }
        11 => {
            let at = draw.below(bytes.len());
            bytes[at] = bytes[at].wrapping_add(draw.below(35) as u8).wrapping_sub(17);
        }
        12 => {
            let (a, b) = (draw.stretch(bytes.len()), draw.below(bytes.len()));
            let piece: Vec<u8> = bytes.drain(a).collect();
            let at = b.min(bytes.len());
            bytes.splice(at..at, piece);
        }
        kind @ 13..=16 => {
            let all = words(bytes);
            let numbers: Vec<_> = all.iter().filter(|w| bytes[(*w).clone()].iter().any(u8::is_ascii_digit)).cloned().collect();
            let Some(word) = draw.one_of(if kind < 16 && !numbers.is_empty() { &numbers } else { &all }).cloned() else { return };
            let other = draw.one_of(&all).cloned().unwrap_or(0..0);
            let with = match kind {
                13 | 14 => draw.one_of(&NUMBERS).copied().unwrap_or("0").as_bytes().to_vec(),
                15 => bytes[other].to_vec(),
                _ => {
                    let source = draw.one_of(corpus).cloned().unwrap_or_default();
                    let from = words(&source);
                    draw.one_of(&from).map(|w| source[w.clone()].to_vec()).unwrap_or_default()
                }
            };
            bytes.splice(word, with);
        }
        17 => {
            // A word twice, or many times.
            let all = words(bytes);
            let Some(word) = draw.one_of(&all).cloned() else { return };
            let mut copy = bytes[word.clone()].to_vec();
            copy.push(b' ');
            let times = 1 << draw.below(8);
            bytes.splice(word.start..word.start, copy.repeat(times));
        }
        _ => {
            // A line twice, gone, or elsewhere.
            let mut lines: Vec<Vec<u8>> = bytes.split_inclusive(|b| *b == b'\n').map(<[u8]>::to_vec).collect();
            let (from, to) = (draw.below(lines.len()), draw.below(lines.len()));
            match draw.below(3) {
                0 => lines.insert(to, lines[from].clone()),
                1 => drop(lines.remove(from)),
                _ => lines.swap(from, to),
            }
            *bytes = lines.concat();
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_number_gives_the_same_bytes_and_others_differ() {
        let corpus = vec![b"v 1 2 3\nf 1 2 3\n".to_vec(), vec![0, 255, 7, 9, 200]];
        assert_eq!(input("t", &corpus, 1, 0), corpus[0]);
        let all: Vec<Vec<u8>> = (2..4000).map(|i| input("t", &corpus, 1, i)).collect();
        assert!(all.iter().enumerate().all(|(i, b)| *b == input("t", &corpus, 1, i as u64 + 2)));
        let distinct: std::collections::BTreeSet<&Vec<u8>> = all.iter().collect();
        assert!(distinct.len() > 2000, "{}", distinct.len());
        assert_ne!(input("t", &corpus, 2, 77), input("t", &corpus, 1, 77));
        assert!(all.iter().all(|b| b.len() <= MAX_BYTES));
        assert!(input("t", &[], 1, 5).len() < 64);
    }
}
