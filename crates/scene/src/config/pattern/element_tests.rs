//! Files of elements that have a response each.

use super::*;
use crate::config::{ReceiverConfig, SceneConfig, from_toml};

const ARRAY: ElementGrid = ElementGrid { rows: 3, cols: 2, spacing_wavelengths: [0.5, 0.7] };

fn unit(tilt_deg: f64, pan_deg: f64) -> DVec3 {
    grid::direction(tilt_deg, pan_deg)
}

/// Amplitude and phase (radians) of an element towards a direction as lines of a file, tilts and pans every ten degrees.
fn lines(array: ElementGrid, response: impl Fn(usize, DVec3) -> (f64, f64)) -> String {
    let mut text = String::new();
    for (tilt, pan) in (-90..=90).step_by(10).flat_map(|t| (-180..180).step_by(10).map(move |p| (t, p))) {
        for m in 0..array.count() {
            let (amplitude, phase) = response(m, unit(f64::from(tilt), f64::from(pan)));
            text += &format!("{tilt},{pan},{m},{},{}\n", amplitude * phase.cos(), amplitude * phase.sin());
        }
    }
    text
}

const PARTS: &str = "elevation_deg,azimuth_deg,element,re,im\n";

fn read_of(text: &str, settings: &str, array: ElementGrid) -> Result<Elements> {
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(dir.path().join("e.csv"), text).unwrap();
    let receiver: ReceiverConfig = from_toml(&format!("pattern = {{ file = \"e.csv\"{settings} }}"), "t.toml")?;
    let pattern = receiver.pattern.read(dir.path(), "receiver.pattern", Some(array))?;
    Ok(pattern.elements().expect("elements"))
}

fn read(text: &str, settings: &str) -> Result<Elements> {
    read_of(text, settings, ARRAY)
}

/// Phase of a plane wave at an element, from its place in wavelengths.
fn of_place(m: usize, u: DVec3) -> f64 {
    let (column, row) = (m / ARRAY.rows, m % ARRAY.rows);
    let (y, z) = ((column as f64 - 0.5) * 0.5, (1.0 - row as f64) * 0.7);
    std::f64::consts::TAU * (y * u.y + z * u.z)
}

/// Amplitude and phase over an isotropic element at the same place, smooth over direction.
fn own(m: usize, u: DVec3) -> (f64, f64) {
    (0.4 + 0.05 * m as f64 + 0.2 * u.x, 0.8 * m as f64 + 0.3 * u.z * m as f64)
}

fn responses(elements: Elements, u: DVec3) -> Vec<[f64; 2]> {
    let mut all = vec![];
    elements.each(u, |_, response| all.push(response));
    all
}

#[test]
fn phases_counted_from_the_array_and_from_each_element_are_one_array() {
    let by_element = read(&(PARTS.to_owned() + &lines(ARRAY, own)), ", phases = \"element\"").unwrap();
    let with_places = |m: usize, u: DVec3| (own(m, u).0, own(m, u).1 + of_place(m, u));
    let by_array = read(&(PARTS.to_owned() + &lines(ARRAY, with_places)), "").unwrap();
    // The same in decibels and degrees.
    let polar =
        lines(ARRAY, with_places).lines().fold("tilt_deg,pan_deg,element,gain_db,phase_deg\n".to_owned(), |text, line| {
            let v: Vec<f64> = line.split(',').map(|v| v.parse().unwrap()).collect();
            let (level, phase) = (20.0 * v[3].hypot(v[4]).log10(), v[4].atan2(v[3]).to_degrees());
            text + &format!("{},{},{},{level},{phase}\n", v[0], v[1], v[2])
        });
    let polar = read(&polar, ", phases = \"array\"").unwrap();
    for (tilt, pan) in [(0.0, 0.0), (-30.0, 50.0), (37.0, -114.0), (85.0, 175.0)] {
        let u = unit(tilt, pan);
        let all = [by_element, by_array, polar].map(|elements| responses(elements, u));
        for (m, value) in all[0].iter().enumerate() {
            let on_grid = tilt % 10.0 == 0.0 && pan % 10.0 == 0.0;
            let (amplitude, phase) = own(m, u);
            let expected = [amplitude * phase.cos(), amplitude * phase.sin()];
            for other in [&all[1][m], &all[2][m], &expected] {
                // Between samples chords are interpolated: an arc of 0.3·5·10° has a sagitta of a thirtieth.
                let tolerance = if on_grid || !std::ptr::eq(other, &expected) { 1e-6 } else { 0.03 };
                let off = (value[0] - other[0]).hypot(value[1] - other[1]);
                assert!(off < tolerance, "{tilt} {pan} {m}: {value:?} {other:?}");
            }
        }
        let mean = all[0].iter().map(|[re, im]| re * re + im * im).sum::<f64>() / 6.0;
        assert!((by_element.gain(u) - mean).abs() < 1e-12);
        assert!((AntennaPattern::Elements(by_element).amplitude(u).powi(2) - mean).abs() < 1e-12);
    }
}

#[test]
fn phases_that_do_not_fit_the_array_are_refused_by_what_fits() {
    let text = |phase: &dyn Fn(usize, DVec3) -> f64| PARTS.to_owned() + &lines(ARRAY, |m, u| (0.9, phase(m, u)));
    let numbered_by_rows = |m: usize| (m % ARRAY.cols) * ARRAY.rows + m / ARRAY.cols;
    let refused = |phase: &dyn Fn(usize, DVec3) -> f64, settings: &str, words: &str| {
        let message = read(&text(phase), settings).unwrap_err().to_string();
        assert!(message.contains(words) && message.contains("e.csv"), "{words}: {message}");
    };
    refused(&|m, u| of_place(m, u), ", phases = \"element\"", "read as phases = \"array\" they");
    refused(&|_, _| 0.0, "", "read as phases = \"element\" they");
    refused(&|m, u| -of_place(m, u), "", "e^{-jωt}");
    refused(&|m, u| of_place(m, DVec3::new(u.x, -u.y, u.z)), "", "pan counted the other way");
    refused(&|m, u| of_place(m, DVec3::new(u.x, u.y, -u.z)), "", "tilt counted downwards");
    refused(&|m, u| of_place(numbered_by_rows(m), u), "", "numbered along rows first");
    let noise = |m: usize, u: DVec3| 40.0 * (m as f64 + 1.3) * (u.y * 7.0 + u.z * 11.0).sin();
    refused(&noise, ", phases = \"element\"", "however they are read");
    // What an element is off by, whatever the direction, is no matter.
    read(&text(&|m, u| of_place(m, u) + 2.1 * (m * m) as f64), "").unwrap();
}

#[test]
fn each_element_radiates_what_it_is_fed_at_most() {
    let loud = |m: usize| if m == 3 { 1.2 } else { 0.5 };
    let text = PARTS.to_owned() + &lines(ARRAY, |m, _| (loud(m), 0.0));
    let message = read(&text, ", phases = \"element\"").unwrap_err().to_string();
    assert!(message.contains("element 3") && message.contains("1.44") && message.contains("normalize = true"), "{message}");
    let shifted = read(&text, ", phases = \"element\", normalize = true").unwrap();
    let mean = shifted.mean_gains.iter().sum::<f64>() / 6.0;
    assert!((mean - 1.0).abs() < 1e-9 && (shifted.gain(DVec3::Y) - 1.0).abs() < 1e-3, "{mean}");
    assert!((shifted.mean_gains[3] / shifted.mean_gains[0] - 1.44 / 0.25).abs() < 1e-6);
    let quiet = read(&(PARTS.to_owned() + &lines(ARRAY, |_, _| (0.5, 0.0))), ", phases = \"element\"").unwrap();
    assert!(quiet.mean_gains.iter().all(|g| (g - 0.25).abs() < 1e-3) && quiet.shift_db == 0.0);
}

#[test]
fn faulty_files_of_elements_are_refused_by_what_is_wrong() {
    let whole = lines(ARRAY, |m, u| (0.9, of_place(m, u)));
    let without = |wanted: &dyn Fn(&str) -> bool| {
        PARTS.to_owned() + &whole.lines().filter(|l| wanted(l)).fold(String::new(), |t, l| t + l + "\n")
    };
    let of = |line: &str| line.split(',').nth(2).unwrap().to_owned();
    let more = |line: &str| PARTS.to_owned() + &whole + line + "\n";
    for (text, words) in [
        (without(&|l| of(l) != "4"), "5 of the array's 6 elements: 4 missing"),
        (without(&|l| !l.starts_with("10,-50,2,")), "1 of 4104 responses"),
        (without(&|l| !l.starts_with("10,-50,2,")), "element 2 at tilt 10.0000 and pan -50.0000"),
        (without(&|l| !l.starts_with("10,") || of(l) == "0"), "are missing, first element 1 at tilt 10.0000"),
        (more("10,-50,2,0.1,0.2"), "stands there twice"),
        (more("10,-50,6,0.1,0.2"), "element \"6\", and the array has 6 elements"),
        (more("10,-50,-1,0.1,0.2"), "number them from 0 to 5"),
        (more("10,-50,1.5,0.1,0.2"), "element \"1.5\""),
        (more("11,-50,2,nan,0.2"), "\"nan\" is no finite number"),
        (without(&|l| l.starts_with("0,")), "nothing says what is beyond"),
        (without(&|_| true).replace("_deg", "_rad"), "look like degrees"),
        (without(&|_| true).replace("re,im", "re,phase_deg"), "re and im, or gain_db and phase_deg"),
        (without(&|_| true).replace("re,im", "re,imaginary"), "re and im"),
        (PARTS.to_owned() + &lines(ARRAY, |_, _| (0.0, 0.0)), "responds to anything"),
    ] {
        let message = read(&text, "").unwrap_err().to_string();
        assert!(message.contains(words) && message.contains("e.csv"), "{words}: {message}");
    }
    let other = ElementGrid { rows: 2, ..ARRAY };
    assert!(read_of(&without(&|_| true), "", other).unwrap_err().to_string().contains("and the array has 4 elements"));
    // Where phases are counted from is said of what has some.
    let gains = "tilt_deg,pan_deg,gain_db\n-90,-90,0\n-90,90,0\n90,-90,0\n90,90,0\n";
    assert!(read(gains, ", phases = \"array\"").unwrap_err().to_string().contains("has gains alone"));
}

#[test]
fn a_part_of_the_sphere_with_a_word_on_the_rest() {
    let front = lines(ARRAY, own).lines().fold(PARTS.to_owned(), |text, line| {
        let pan: f64 = line.split(',').nth(1).unwrap().parse().unwrap();
        if pan.abs() <= 90.0 { text + line + "\n" } else { text }
    });
    let elements = read(&front, ", phases = \"element\", outside_db = -40").unwrap();
    for [re, im] in responses(elements, unit(20.0, 150.0)) {
        assert!((re - 0.01).abs() < 1e-12 && im == 0.0);
    }
    assert!((elements.gain(unit(20.0, 150.0)) - 1e-4).abs() < 1e-12 && elements.gain(DVec3::X) > 0.1);
}

#[test]
fn a_scene_has_them_for_its_receiver_alone_and_records_hold_them_whole() {
    let dir = tempfile::tempdir().unwrap();
    let text = PARTS.to_owned() + &lines(ARRAY, |m, u| (0.9, of_place(m, u) + m as f64));
    std::fs::write(dir.path().join("e.csv"), text).unwrap();
    let scene = |transmitter: &str, cols: usize| {
        let path = dir.path().join("s.toml");
        let text = format!(
            "[scene]\nfile = \"m.obj\"\n[transmitter]\nposition_m = [0, 0, 1]\n{transmitter}\n[receiver]\nrows = 3\ncols = {cols}\nspacing_wavelengths = [0.5, 0.7]\n\
             pattern = {{ file = \"e.csv\" }}\n"
        );
        std::fs::write(&path, text).unwrap();
        SceneConfig::load(&path)
    };
    let config = scene("", 2).unwrap();
    let json = serde_json::to_string(&config.receiver).unwrap();
    let back: ReceiverConfig = serde_json::from_str(&json).unwrap();
    assert_eq!(back, config.receiver);
    assert_eq!(
        responses(back.pattern.elements().unwrap(), DVec3::Y),
        responses(config.receiver.pattern.elements().unwrap(), DVec3::Y)
    );
    // Of another array they are refused, also where a record is changed by hand.
    let message = scene("", 3).unwrap_err().to_string();
    assert!(message.contains("6 of the array's 9 elements: 6, 7, 8 missing"), "{message}");
    let changed: ReceiverConfig = serde_json::from_str(&json.replacen("\"cols\":2", "\"cols\":4", 1)).unwrap();
    let message = changed.validate("receiver").unwrap_err().to_string();
    assert!(message.contains("3x2 elements") && message.contains("3x4 elements"), "{message}");
    let message = scene("pattern = { file = \"e.csv\" }", 2).unwrap_err().to_string();
    assert!(message.contains("one by one") && message.contains("[receiver]"), "{message}");
}
