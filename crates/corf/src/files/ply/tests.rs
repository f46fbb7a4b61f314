use super::*;
use crate::{Antialias, RadioTarget};
use corf_scene::{Rng, keyframe::DbRange};

const NOTES: Notes = Notes {
    antialias: Antialias::On,
    up: [0, 0, 1],
    radio_target: RadioTarget::Jet,
    db_range: DbRange { min_db: -130.0, max_db: -60.0 },
    radio_background: [0.0, 0.0, 0.5],
    offset_m: None,
};

fn header(path: &Path) -> Vec<String> {
    header_of(&std::fs::read(path).unwrap())
}

/// The lines of a header.
fn header_of(bytes: &[u8]) -> Vec<String> {
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap();
    String::from_utf8(bytes[..end].to_vec()).unwrap().lines().map(String::from).collect()
}

fn random(n: usize, radio_channels: usize, light_degree: usize, radio_degree: usize) -> Gaussians {
    let mut rng = Rng::keyed(1, 2, 3);
    let mut g = Gaussians::empty(radio_channels, light_degree);
    g.radio = Appearance::empty(radio_channels, radio_degree);
    let mut draw = |n: usize| (0..n).map(|_| rng.uniform() - 0.5).collect::<Vec<f32>>();
    for _ in 0..n {
        let d = draw(10);
        g.position.push([d[0], d[1], d[2]]);
        g.rotation.push([d[3], d[4], d[5], d[6]]);
        g.log_scale.push([d[7], d[8], d[9]]);
        for a in [&mut g.light, &mut g.radio] {
            a.opacity_logit.extend(draw(1));
            a.sh.extend(draw(a.stride()));
        }
    }
    g
}

#[test]
fn coupled_files_round_trip_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    for (radio_channels, light_degree, radio_degree) in [(3, 3, 3), (1, 2, 3), (1, 0, 0), (3, 0, 1)] {
        let g = random(17, radio_channels, light_degree, radio_degree);
        let path = folder.path().join("coupled.ply");
        write_coupled(&path, &g, &NOTES).unwrap();
        assert_eq!(read_coupled(&path).unwrap(), g);
        let light = read_single(&path).unwrap();
        assert_eq!((light.position, light.appearance), (g.position.clone(), g.light.clone()));
        write_radio(&path, &g, &NOTES).unwrap();
        assert_eq!(read_single(&path).unwrap().appearance, g.radio);
        let error = read_coupled(&path).unwrap_err().to_string();
        assert!(error.contains("channel") || error.contains("rf_f_dc_0"), "{error}");
    }
    let left: Vec<_> = std::fs::read_dir(folder.path()).unwrap().collect();
    assert_eq!(left.len(), 1, "no temporary file is left");
}

#[test]
fn the_columns_are_those_of_the_reference_implementation_and_channel_major() {
    let folder = tempfile::tempdir().unwrap();
    let g = random(2, 1, 1, 0);
    let path = folder.path().join("optical.ply");
    write_light(&path, &g, &NOTES).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let header = std::str::from_utf8(&bytes[..end]).unwrap();
    let names: Vec<&str> = header.lines().filter_map(|l| l.strip_prefix("property float ")).collect();
    let expected = "x y z nx ny nz f_dc_0 f_dc_1 f_dc_2 f_rest_0 f_rest_1 f_rest_2 f_rest_3 f_rest_4 f_rest_5 f_rest_6 f_rest_7 f_rest_8 \
                    opacity scale_0 scale_1 scale_2 rot_0 rot_1 rot_2 rot_3";
    assert_eq!(names, expected.split_whitespace().collect::<Vec<_>>());
    assert_eq!(bytes.len() - end, 2 * names.len() * 4);
    let value = |i: usize, name: &str| {
        let at = end + 4 * (i * names.len() + names.iter().position(|n| *n == name).unwrap());
        f32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
    };
    // Second coefficient of the green channel of Gaussian 1: channel-major slot 3.
    assert_eq!(value(1, "f_rest_3"), g.light.sh[g.light.stride() + 3 + 1]);
    assert_eq!(value(1, "rot_0"), g.rotation[1][0]);
    assert_eq!(value(0, "opacity"), g.light.opacity_logit[0]);
}

#[test]
fn extra_columns_do_not_begin_like_standard_ones() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("coupled.ply");
    write_coupled(&path, &random(1, 3, 1, 1), &NOTES).unwrap();
    let bytes = std::fs::read(&path).unwrap();
    let header = String::from_utf8_lossy(&bytes);
    let extra = header.lines().filter_map(|l| l.strip_prefix("property float ")).skip_while(|n| *n != "rot_3").skip(1);
    let mut count = 0;
    for name in extra {
        assert!(!["rot", "scale_", "f_rest_", "f_dc_", "red"].iter().any(|p| name.starts_with(p)), "{name}");
        count += 1;
    }
    assert_eq!(count, 1 + 12);
}

#[test]
fn damaged_files_are_refused_with_what_and_where() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("coupled.ply");
    write_coupled(&path, &random(5, 1, 1, 1), &NOTES).unwrap();
    let whole = std::fs::read(&path).unwrap();
    let refused = |bytes: &[u8]| {
        std::fs::write(&path, bytes).unwrap();
        read_coupled(&path).unwrap_err().to_string()
    };
    let error = refused(&whole[..whole.len() - 3]);
    assert!(error.contains("vertex 4 of 5") && error.contains("truncated") && error.contains("coupled.ply"), "{error}");
    assert!(refused(b"PK\x03\x04").contains("no PLY header"));
    assert!(refused(b"ply\nformat ascii 1.0\nelement vertex 0\nend_header\n").contains("no column `x`"));
    assert!(refused(b"ply\nelement vertex 0\nproperty float x\nend_header\n").contains("does not state its format"));
    assert!(refused(&[&whole[..], b"1234"].concat()).contains("header and the data disagree"));
    let doubled = |line: &str| {
        let at = whole.windows(line.len()).position(|w| w == line.as_bytes()).unwrap();
        refused(&[&whole[..at], line.as_bytes(), &whole[at..]].concat())
    };
    let error = doubled("property float y\n");
    let at = 2 + header_of(&whole).iter().position(|l| l == "property float y").unwrap();
    assert!(error.contains(&format!("header line {at}: a second property `y`")), "{error}");
    assert!(doubled("element vertex 5\n").contains("a second `element vertex`"));
    let end = whole.windows(11).position(|w| w == b"end_header\n").unwrap() + 11;
    let text = String::from_utf8_lossy(&whole[..end]).replace("property float y", "property float q");
    let renamed = [text.as_bytes(), &whole[end..]].concat();
    assert!(refused(&renamed).contains("`y`"));
    let mut nan = whole.clone();
    nan[end..end + 4].copy_from_slice(&f32::NAN.to_le_bytes());
    assert!(refused(&nan).contains("vertex 0, column `x`"));
    assert!(read_coupled(&folder.path().join("missing.ply")).unwrap_err().to_string().contains("missing.ply"));
}

#[test]
fn headers_say_how_the_gaussians_are_to_be_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let (path, g) = (folder.path().join("field.ply"), random(3, 3, 1, 2));
    let says = |line: &str| header(&path).iter().any(|l| l == line);
    write_radio(&path, &g, &NOTES).unwrap();
    for line in [
        "comment SplatRenderMode: mip",
        "comment Vertical axis: 0 0 1",
        "comment SH degree: 2",
        "comment corf background of f_dc: 0 0 0.5",
        "comment corf colour of f_dc: Jet colour of 10 log10 of power, -130 to -60 dB",
    ] {
        assert!(says(line), "{line}: {:?}", header(&path));
    }
    assert_eq!(read_foreign(&path).unwrap().antialiased, Some(true));
    write_coupled(&path, &g, &Notes { antialias: Antialias::Off, ..NOTES }).unwrap();
    assert!(says("comment SplatRenderMode: default") && says("comment SH degree: 1") && says("comment SH degree of rf_f_dc: 2"));
    assert!(says("comment corf background of rf_f_dc: 0 0 0.5"));
    assert_eq!(read_foreign(&path).unwrap().antialiased, Some(false));
    write_light(&path, &g, &NOTES).unwrap();
    assert!(!header(&path).iter().any(|l| l.contains("background")));

    // A file of before there were comments is read as it was.
    let bytes = std::fs::read(&path).unwrap();
    let before: Vec<u8> =
        bytes.split_inclusive(|b| *b == b'\n').filter(|l| !l.starts_with(b"comment")).flatten().copied().collect();
    assert!(before.len() < bytes.len());
    let with = read_single(&path).unwrap();
    std::fs::write(&path, before).unwrap();
    assert_eq!(read_single(&path).unwrap(), with);
    assert_eq!(read_foreign(&path).unwrap().antialiased, None);
}

#[test]
fn fields_of_other_programs_are_refused_with_what_is_wrong() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("theirs.ply");
    let refused = |g: &Gaussians| {
        write_light(&path, g, &NOTES).unwrap();
        read_foreign(&path).unwrap_err().to_string()
    };
    assert!(refused(&random(0, 1, 0, 0)).contains("no Gaussians"));
    let mut still = random(3, 1, 0, 0);
    still.rotation[2] = [0.0; 4];
    assert!(refused(&still).contains("vertex 2: rot_0"));
    let mut metres = random(3, 1, 0, 0);
    metres.log_scale[1] = [1.0, 50.0, 1.0];
    assert!(refused(&metres).contains("vertex 1: scale_0"));
    write_radio(&path, &random(3, 1, 0, 0), &NOTES).unwrap();
    assert!(read_foreign(&path).unwrap_err().to_string().contains("1 channel"));
}

/// Columns of a degree-0 field, by name, and a value for each in row `i`.
const COLUMNS: [&str; 14] =
    ["x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2", "rot_0", "rot_1", "rot_2", "rot_3"];

fn value(i: usize, k: usize) -> f64 {
    // Exact in single precision, and of both signs.
    (i as f64 + 1.0) * 0.25 - k as f64 * 0.125
}

/// A file's bytes, by hand: header lines and rows as (type, value).
struct Hand {
    format: &'static str,
    end: &'static str,
    header: String,
    body: Vec<u8>,
}

impl Hand {
    fn new(format: &'static str, end: &'static str) -> Self {
        Self { format, end, header: String::new(), body: vec![] }
    }

    fn line(&mut self, line: &str) {
        self.header += line;
        self.header += self.end;
    }

    /// Writes a number of a type that PLY knows by this name.
    fn put(&mut self, kind: &str, v: f64) {
        macro_rules! bytes {
            ($t:ty) => {{
                let v = v as $t;
                if self.format == "binary_big_endian" { v.to_be_bytes().to_vec() } else { v.to_le_bytes().to_vec() }
            }};
        }
        let bytes = match kind {
            _ if self.format == "ascii" => format!("{v} ").into_bytes(),
            "char" | "int8" => bytes!(i8),
            "uchar" | "uint8" => bytes!(u8),
            "short" | "int16" => bytes!(i16),
            "ushort" | "uint16" => bytes!(u16),
            "int" | "int32" => bytes!(i32),
            "uint" | "uint32" => bytes!(u32),
            "float" | "float32" => bytes!(f32),
            "double" | "float64" => bytes!(f64),
            other => panic!("{other}"),
        };
        self.body.extend(bytes);
    }

    fn row(&mut self) {
        if self.format == "ascii" {
            self.body.extend(self.end.as_bytes());
        }
    }

    fn file(&self) -> Vec<u8> {
        let Self { format, end, header, body } = self;
        [format!("ply{end}format {format} 1.0{end}comment by hand{end}obj_info x{end}{header}end_header{end}").as_bytes(), body]
            .concat()
    }
}

#[test]
fn every_form_of_a_file_gives_the_same_gaussians() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("theirs.ply");
    let kinds: [[&str; 8]; 2] = [
        ["char", "uchar", "short", "ushort", "int", "uint", "float", "double"],
        ["int8", "uint8", "int16", "uint16", "int32", "uint32", "float32", "float64"],
    ];
    let mut read = vec![];
    for format in ["ascii", "binary_little_endian", "binary_big_endian"] {
        for (end, names, own) in [("\n", kinds[0], "float"), ("\r\n", kinds[1], "float64"), ("\n", kinds[1], "double")] {
            let mut hand = Hand::new(format, end);
            // An element before the vertices with lists of every length type, and one behind.
            hand.line("element before 2");
            hand.line(&format!("property {} a", names[2]));
            (0..6).for_each(|k| hand.line(&format!("property list {} {} l{k}", names[k], names[7 - k])));
            for i in 0..2 {
                hand.put(names[2], -7.0);
                for k in 0..6 {
                    hand.put(names[k], (i + k) as f64);
                    (0..i + k).for_each(|_| hand.put(names[7 - k], 3.0));
                }
                hand.row();
            }
            hand.line("element vertex 3");
            // Backwards, with a column of every type between, and a list in one of the forms.
            let with_list = own == "double";
            for (k, name) in COLUMNS.iter().enumerate().rev() {
                hand.line(&format!("property {} extra_{k}", names[k % 8]));
                hand.line(&format!("property {own} {name}"));
            }
            if with_list {
                hand.line(&format!("property list {} {} neighbours", names[1], names[4]));
            }
            for i in 0..3 {
                for k in (0..COLUMNS.len()).rev() {
                    hand.put(names[k % 8], 100.0);
                    hand.put(own, value(i, k));
                }
                if with_list {
                    hand.put(names[1], i as f64);
                    (0..i).for_each(|_| hand.put(names[4], -1.0));
                }
                hand.row();
            }
            hand.line("element face 1");
            hand.line(&format!("property list {} {} vertex_indices", names[1], names[4]));
            hand.put(names[1], 3.0);
            (0..3).for_each(|k| hand.put(names[4], f64::from(k)));
            hand.row();
            std::fs::write(&path, hand.file()).unwrap();
            let field = read_foreign(&path).unwrap_or_else(|e| panic!("{format} {own}: {e}"));
            assert_eq!(field.unread.len(), COLUMNS.len(), "{:?}", field.unread);
            read.push(field.gaussians);
            // Cuts are refused, and so is what follows.
            let whole = hand.file();
            for cut in (1..whole.len()).step_by(11).chain([whole.len() - 1]) {
                // The last line's end is no part of a text.
                if format != "ascii" || !whole[cut..].iter().all(|b| b.is_ascii_whitespace()) {
                    std::fs::write(&path, &whole[..cut]).unwrap();
                    // A shorter number may be a number.
                    assert!(read_foreign(&path).is_err() || format == "ascii" && whole.len() - cut < 3, "{format} {own} {cut}");
                }
            }
            std::fs::write(&path, [&whole[..], b"7 7"].concat()).unwrap();
            assert!(read_foreign(&path).unwrap_err().to_string().contains("header and the data disagree"), "{format}");
        }
    }
    let first = &read[0];
    assert_eq!(first.position[2], [0.75, 0.625, 0.5]);
    assert_eq!(first.rotation[1], [10, 11, 12, 13].map(|k| value(1, k) as f32));
    assert!(read.len() == 9 && read.iter().all(|field| field == first));
}

/// A text file of one Gaussian with further columns and values; columns that are to be left out begin with `-`.
fn text_file(path: &Path, more: &[(&str, &str, f64)]) -> Result<ForeignField> {
    let left_out = |name: &str| more.iter().any(|(_, other, _)| other.strip_prefix('-') == Some(name));
    let mut columns: Vec<(&str, &str, f64)> =
        COLUMNS.iter().enumerate().filter(|(_, name)| !left_out(name)).map(|(k, name)| ("float", *name, value(0, k))).collect();
    columns.extend(more.iter().filter(|(_, name, _)| !name.starts_with('-')));
    let header: String = columns.iter().map(|(kind, name, _)| format!("property {kind} {name}\n")).collect();
    let row: Vec<String> = columns.iter().map(|(_, _, v)| v.to_string()).collect();
    std::fs::write(path, format!("ply\nformat ascii 1.0\nelement vertex 1\n{header}end_header\n{}\n", row.join(" "))).unwrap();
    read_foreign(path)
}

#[test]
fn columns_that_make_gaussians_something_else_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("theirs.ply");
    let refused = |more: &[(&str, &str, f64)], words: &[&str]| {
        let message = text_file(&path, more).unwrap_err().to_string();
        assert!(words.iter().all(|word| message.contains(word)), "{message}");
    };
    refused(&[("float", "-scale_2", 0.0)], &["two scales", "2DGS"]);
    refused(&[("float", "-rot_0", 0.0)], &["no column `rot_0`"]);
    refused(&[("float", "rot_4", 0.0)], &["rot_4"]);
    refused(&[("float", "t", 0.0)], &["`t`", "change with time"]);
    refused(&[("float", "trbf_center", 0.0)], &["trbf_center", "time"]);
    refused(&[("float", "f_offset_0", 0.0)], &["Scaffold-GS"]);
    refused(&[("float", "packed_position", 0.0)], &["compressed", "splat-transform"]);
    refused(&[("float", "filter_3d", 0.0)], &["filter_3d", "Mip-Splatting"]);
    refused(&[("float", "filter_3D", -0.5)], &["vertex 0", "-0.5"]);
    refused(&[("uchar", "filter_3D", 1.0)], &["filter_3D", "uchar"]);
    refused(&[("float", "-opacity", 0.0), ("uchar", "opacity", 9.0)], &["`opacity`", "uchar"]);
    refused(&[("float", "f_dc_4", 0.0)], &["f_dc_3"]);
    refused(&[("float", "f_rest_1", 0.0)], &["f_rest_0"]);
    let fourth: Vec<String> = (0..72).map(|i| format!("f_rest_{i}")).collect();
    refused(&fourth.iter().map(|name| ("float", name.as_str(), 0.0)).collect::<Vec<_>>(), &["degree 4"]);
    refused(&[("double", "-x", 0.0), ("double", "x", 1e300)], &["column `x` is inf"]);
    let field = text_file(&path, &[("uchar", "red", 200.0), ("float", "nx", 0.0), ("int", "label", -3.0)]).unwrap();
    assert_eq!((field.unread, field.filter_3d, field.up), (vec!["red".to_owned(), "label".to_owned()], false, None));
}

#[test]
fn a_filter_in_three_dimensions_is_applied_as_its_program_does() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("theirs.ply");
    let plain = text_file(&path, &[]).unwrap().gaussians;
    for filter in [0.0, 1e-6, 0.3, 5.0] {
        let field = text_file(&path, &[("float", "filter_3D", filter)]).unwrap();
        assert!(field.filter_3d && field.unread.is_empty());
        let filter = f64::from(filter as f32);
        let (mut before, mut after) = (1.0, 1.0);
        for k in 0..3 {
            let s2 = (2.0 * f64::from(plain.log_scale[0][k])).exp();
            before *= s2;
            after *= s2 + filter * filter;
            let expected = 0.5 * (s2 + filter * filter).ln();
            assert!((f64::from(field.gaussians.log_scale[0][k]) - expected).abs() < 1e-6, "{filter} {k}");
        }
        let opacity = |logit: f32| 1.0 / (1.0 + (-f64::from(logit)).exp());
        let expected = opacity(plain.appearance.opacity_logit[0]) * (before / after).sqrt();
        let found = opacity(field.gaussians.appearance.opacity_logit[0]);
        assert!((found / expected - 1.0).abs() < 1e-6, "{filter}: {found} {expected}");
        assert_eq!((field.gaussians.position[0], field.gaussians.rotation[0]), (plain.position[0], plain.rotation[0]));
    }
}

#[test]
fn a_header_says_what_is_up_and_what_was_taken_off() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("field.ply");
    let notes = Notes { up: [0, -1, 0], offset_m: Some([446_000.0, -3.5, 0.0]), ..NOTES };
    write_light(&path, &random(2, 3, 0, 0), &notes).unwrap();
    assert!(header(&path).iter().any(|l| l.starts_with("comment corf offset: 446000 -3.5 0 m")));
    assert_eq!(read_foreign(&path).unwrap().up, Some([0.0, -1.0, 0.0]));
}
