use super::*;
use crate::config::{SceneConfig, from_toml};

/// A file of a pattern's gain every so many degrees.
fn table(step_deg: f64, gain_db: impl Fn(DVec3) -> f64) -> String {
    let mut text = "tilt_deg,pan_deg,gain_db\n".to_owned();
    let (rows, columns) = ((180.0 / step_deg).round() as i32, (360.0 / step_deg).round() as i32);
    for i in 0..=rows {
        for j in 0..columns {
            let (tilt, pan) = (-90.0 + f64::from(i) * step_deg, -180.0 + f64::from(j) * step_deg);
            let ((z, r), (y, x)) = (tilt.to_radians().sin_cos(), pan.to_radians().sin_cos());
            text += &format!("{tilt},{pan},{}\n", gain_db(DVec3::new(r * x, r * y, z)));
        }
    }
    text
}

fn read(text: &str, settings: &str) -> Result<AntennaPattern> {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("p.csv"), text).unwrap();
    let written: std::collections::BTreeMap<String, AntennaPattern> =
        from_toml(&format!("pattern = {{ file = \"p.csv\"{settings} }}"), "t.toml").unwrap();
    written["pattern"].read(dir.path(), "transmitter.pattern", None)
}

fn directions() -> impl Iterator<Item = DVec3> {
    (0..2000).map(|i| {
        let mut rng = crate::Rng::keyed(5, 0, i);
        DVec3::new(rng.normal(), rng.normal(), rng.normal()).normalize()
    })
}

fn decibels(pattern: AntennaPattern, u: DVec3) -> f64 {
    20.0 * pattern.amplitude(u).log10()
}

#[test]
fn an_isotropic_file_is_the_isotropic_element() {
    let pattern = read(&table(30.0, |_| 0.0), "").unwrap();
    assert!(directions().all(|u| (pattern.amplitude(u) - 1.0).abs() < 1e-12));
    let AntennaPattern::Sampled(sampled) = pattern else { panic!("{pattern:?}") };
    assert!((sampled.mean_gain - 1.0).abs() < 1e-3 && sampled.shift_db == 0.0);
}

#[test]
fn a_sampled_pattern_is_the_built_in_one_within_the_error_of_interpolation() {
    // In decibels 38.901's element is a parabola of 12/65² dB a squared degree along each angle, which two degrees of linear interpolation miss by h²/8·2·12/65².
    let built_in = AntennaPattern::Tr38901;
    let pattern = read(&table(2.0, |u| decibels(built_in, u)), "").unwrap();
    let most = 2.0 * (4.0 / 8.0) * 2.0 * 12.0 / (65.0 * 65.0);
    // At the floor's edges the parabola has a corner, over which a cell interpolates: the slope of 1.1 dB a degree over half a cell.
    let off: Vec<f64> = directions().map(|u| (decibels(pattern, u) - decibels(built_in, u)).abs()).collect();
    let beyond = off.iter().filter(|e| **e > most).count();
    assert!(beyond < off.len() / 20 && off.iter().all(|e| *e < 1.2), "{beyond} {:?}", off.iter().copied().fold(0.0, f64::max));
    // Its own two cuts say the same, with theta from the zenith and angles in radians as well.
    let mut cuts = "cut,angle_deg,gain_db\n".to_owned();
    for angle in (-90..=90).step_by(2) {
        cuts += &format!("vertical,{angle},{}\n", 8.0 - (12.0 * (f64::from(angle) / 65.0).powi(2)).min(30.0));
    }
    for angle in (-180..180).step_by(2) {
        cuts += &format!("horizontal,{angle},{}\n", 8.0 - (12.0 * (f64::from(angle) / 65.0).powi(2)).min(30.0));
    }
    let of_cuts = read(&cuts, "").unwrap();
    assert!(directions().all(|u| (decibels(of_cuts, u) - decibels(built_in, u)).abs() < 1.2));
    let radians =
        table(10.0, |u| decibels(built_in, u)).lines().skip(1).fold("theta_rad,phi_rad,gain_dbi\n".to_owned(), |text, line| {
            let v: Vec<f64> = line.split(',').map(|v| v.parse().unwrap()).collect();
            text + &format!("{},{},{}\n", (90.0 - v[0]).to_radians(), v[1].to_radians(), v[2])
        });
    let (a, b) = (read(&radians, "").unwrap(), read(&table(10.0, |u| decibels(built_in, u)), "").unwrap());
    assert!(directions().all(|u| (decibels(a, u) - decibels(b, u)).abs() < 1e-6));
}

#[test]
fn no_antenna_radiates_more_than_it_is_fed_unless_it_is_shifted() {
    let message = read(&table(10.0, |_| 3.0), "").unwrap_err().to_string();
    assert!(message.contains("1.99") && message.contains("normalize = true"), "{message}");
    let shifted = read(&table(10.0, |u| 3.0 + 6.0 * u.x), ", normalize = true").unwrap();
    let mean = directions().map(|u| shifted.amplitude(u).powi(2)).sum::<f64>() / 2000.0;
    assert!((mean - 1.0).abs() < 0.05, "{mean}");
    assert!((decibels(shifted, DVec3::X) - decibels(shifted, DVec3::NEG_X) - 12.0).abs() < 1e-9);
}

#[test]
fn part_of_a_sphere_needs_a_word_on_the_rest_and_few_holes_are_filled() {
    // As a measurement with a head that tilts by 30 degrees and pans by less than a turn.
    let mut text = "tilt_rad,pan_rad,snr_norm\n".to_owned();
    for tilt in (-30..=30).step_by(3) {
        for pan in (-156..=156).step_by(3) {
            if (tilt, pan) != (0, 30) {
                text += &format!(
                    "{},{},{}\n",
                    f64::from(tilt).to_radians(),
                    f64::from(pan).to_radians(),
                    -0.1 * f64::from(pan).abs()
                );
            }
        }
    }
    let message = read(&text, "").unwrap_err().to_string();
    assert!(message.contains("-30.00 to 30.00") && message.contains("outside_db"), "{message}");
    let pattern = read(&text, ", outside_db = -40").unwrap();
    let at = |tilt: f64, pan: f64| {
        let ((z, r), (y, x)) = (tilt.to_radians().sin_cos(), pan.to_radians().sin_cos());
        decibels(pattern, DVec3::new(r * x, r * y, z))
    };
    // Positive pans are to the left.
    assert!((at(0.0, 30.0) + 3.0).abs() < 1e-6 && (at(10.0, -45.0) + 4.5).abs() < 1e-6);
    assert!((at(31.0, 0.0) + 40.0).abs() < 1e-9 && (at(0.0, 170.0) + 40.0).abs() < 1e-9);
    let AntennaPattern::Sampled(sampled) = pattern else { panic!() };
    assert_eq!(sampled.filled, 1);
}

#[test]
fn faulty_files_are_refused_by_what_is_wrong() {
    for (text, words) in [
        ("", "empty"),
        ("tilt_deg,pan_deg,gain_db\n0,0\n", ":2"),
        ("tilt_deg,pan_deg,gain_db\n0,0,loud\n", "\"loud\""),
        ("tilt_deg,pan_deg\n0,0\n", "gains in decibels"),
        ("tilt_deg,gain_db\n0,0\n", "pans"),
        ("tilt_deg,pan_deg,gain_db,who\n0,0,0,1\n", "\"who\""),
        ("tilt_deg,pan_deg,gain_db,phase_deg\n0,0,0,1\n", "phases"),
        ("tilt_deg,pan_deg,gain_db\n0,0,0\n0,0,1\n", "twice"),
        ("tilt_deg,pan_deg,gain_db\n0,0,0\n1,5,1\n2,9,1\n", "no grid"),
        ("tilt_deg,pan_deg,gain_db\n0,0,0\n0,10,1\n100,0,1\n100,10,1\n", "tilts from -90"),
        ("tilt_deg,pan_deg,gain_db\n0,0,0\n0,10,500\n", "500 dB"),
        ("cut,angle_deg,gain_db\nh,0,0\nh,10,0\n", "both cuts"),
        ("cut,angle_deg,gain_db\ndiagonal,0,0\n", "\"diagonal\""),
        ("tilt_deg,pan_deg,gain_db\n0,-3.14,0\n0,0,0\n0,3.14,0\n", "look like radians"),
        ("tilt_rad,pan_rad,gain_db\n0,-180,0\n0,0,0\n0,179,0\n", "look like degrees"),
        ("cut,angle_deg,gain_db\nh,-3,0\nh,3,0\nv,-1,0\nv,1,0\n", "look like radians"),
        ("tilt_deg,pan_deg,element,re,im\n0,0,0,1,0\n0,9,0,1,0\n", "of an array's elements one by one"),
    ] {
        let message = read(text, ", outside_db = -30").unwrap_err().to_string();
        assert!(message.contains(words) && message.contains("p.csv"), "{text}: {message}");
    }
    let unread = from_toml::<crate::config::ReceiverConfig>("pattern = { file = \"p.csv\" }", "t.toml").unwrap();
    assert!(unread.validate("receiver").unwrap_err().to_string().contains("p.csv"));
    let message = from_toml::<crate::config::ReceiverConfig>("pattern = \"isoo\"", "t.toml").unwrap_err().to_string();
    assert!(message.contains("iso"), "{message}");
    assert!(from_toml::<crate::config::ReceiverConfig>("pattern = { folder = \"p.csv\" }", "t.toml").is_err());
}

#[test]
fn a_scene_reads_its_patterns_and_records_hold_them_whole() {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("p.csv"), table(15.0, |u| 3.0 * u.x - 3.0)).unwrap();
    let path = dir.path().join("s.toml");
    let text = "[scene]\nfile = \"m.obj\"\n[transmitter]\nposition_m = [0, 0, 1]\npattern = { file = \"p.csv\" }\n[receiver]\npattern = { file = \"p.csv\", normalize = true }\n";
    std::fs::write(&path, text).unwrap();
    let config = SceneConfig::load(&path).unwrap();
    let u = DVec3::new(0.6, 0.8, 0.0);
    assert!((decibels(config.transmitter.pattern, DVec3::X)).abs() < 1e-9);
    assert!(config.transmitter.pattern.amplitude(u) < config.receiver.pattern.amplitude(u));
    // What is written of it needs no file.
    let json = serde_json::to_string(&config.transmitter).unwrap();
    let back: crate::config::TransmitterConfig = serde_json::from_str(&json).unwrap();
    assert_eq!(back, config.transmitter);
    assert!((back.pattern.amplitude(u) - config.transmitter.pattern.amplitude(u)).abs() == 0.0);
    assert_eq!(serde_json::to_string(&AntennaPattern::Tr38901).unwrap(), "\"tr38901\"");
    assert_eq!(format!("{:?}", AntennaPattern::Iso), "Iso");
}
