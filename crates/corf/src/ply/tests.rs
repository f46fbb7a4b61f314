use super::*;
use crate::{Antialias, RfTarget};
use corf_scene::{Rng, keyframe::DbRange};

const NOTES: Notes = Notes {
    antialias: Antialias::On,
    up: [0, 0, 1],
    rf_target: RfTarget::Jet,
    db_range: DbRange { min_db: -130.0, max_db: -60.0 },
    rf_background: [0.0, 0.0, 0.5],
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

fn random(n: usize, rf_channels: usize, optical_degree: usize, rf_degree: usize) -> Gaussians {
    let mut rng = Rng::keyed(1, 2, 3);
    let mut g = Gaussians::empty(rf_channels, optical_degree);
    g.rf = Appearance::empty(rf_channels, rf_degree);
    let mut draw = |n: usize| (0..n).map(|_| rng.uniform() - 0.5).collect::<Vec<f32>>();
    for _ in 0..n {
        let d = draw(10);
        g.position.push([d[0], d[1], d[2]]);
        g.rotation.push([d[3], d[4], d[5], d[6]]);
        g.log_scale.push([d[7], d[8], d[9]]);
        for a in [&mut g.optical, &mut g.rf] {
            a.opacity_logit.extend(draw(1));
            a.sh.extend(draw(a.stride()));
        }
    }
    g
}

#[test]
fn coupled_files_round_trip_bit_for_bit() {
    let folder = tempfile::tempdir().unwrap();
    for (rf_channels, optical_degree, rf_degree) in [(3, 3, 3), (1, 2, 3), (1, 0, 0), (3, 0, 1)] {
        let g = random(17, rf_channels, optical_degree, rf_degree);
        let path = folder.path().join("coupled.ply");
        write_coupled(&path, &g, &NOTES).unwrap();
        assert_eq!(read_coupled(&path).unwrap(), g);
        let optical = read_single(&path).unwrap();
        assert_eq!((optical.position, optical.appearance), (g.position.clone(), g.optical.clone()));
        write_rf(&path, &g, &NOTES).unwrap();
        assert_eq!(read_single(&path).unwrap().appearance, g.rf);
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
    write_optical(&path, &g, &NOTES).unwrap();
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
    assert_eq!(value(1, "f_rest_3"), g.optical.sh[g.optical.stride() + 3 + 1]);
    assert_eq!(value(1, "rot_0"), g.rotation[1][0]);
    assert_eq!(value(0, "opacity"), g.optical.opacity_logit[0]);
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
    assert!(refused(b"ply\nformat ascii 1.0\nelement vertex 0\nend_header\n").contains("ascii"));
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
    assert!(matches!(read_coupled(&folder.path().join("missing.ply")), Err(Error::Io { .. })));
}

#[test]
fn headers_say_how_the_gaussians_are_to_be_drawn() {
    let folder = tempfile::tempdir().unwrap();
    let (path, g) = (folder.path().join("field.ply"), random(3, 3, 1, 2));
    let says = |line: &str| header(&path).iter().any(|l| l == line);
    write_rf(&path, &g, &NOTES).unwrap();
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
    write_optical(&path, &g, &NOTES).unwrap();
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
        write_optical(&path, g, &NOTES).unwrap();
        read_foreign(&path).unwrap_err().to_string()
    };
    assert!(refused(&random(0, 1, 0, 0)).contains("no Gaussians"));
    let mut still = random(3, 1, 0, 0);
    still.rotation[2] = [0.0; 4];
    assert!(refused(&still).contains("vertex 2: rot_0"));
    let mut metres = random(3, 1, 0, 0);
    metres.log_scale[1] = [1.0, 50.0, 1.0];
    assert!(refused(&metres).contains("vertex 1: scale_0"));
    write_rf(&path, &random(3, 1, 0, 0), &NOTES).unwrap();
    assert!(read_foreign(&path).unwrap_err().to_string().contains("1 channel"));
}
