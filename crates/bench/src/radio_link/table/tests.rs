//! Tables of positions and what they refuse.

use super::*;

fn points(text: &str) -> Vec<[f64; 3]> {
    let table = read(text, "rx.csv").unwrap_or_else(|e| panic!("{text:?}: {e}"));
    table.points.iter().map(|p| p.to_array()).collect()
}

const ONE: [f64; 3] = [4.0, 1.5, 1.2];

#[test]
fn names_say_which_column_is_which() {
    for text in [
        "4.0,1.5,1.2",
        "x,y,z\n4.0,1.5,1.2\n",
        "y,x,z\n1.5,4.0,1.2",
        "Z; Y; X\n1.2; 1.5; 4.0",
        "z\ty\tx\n1.2\t1.5\t4",
        "z y x\n1.2 1.5 4",
        "\u{feff}z_m,x_m,y_m\r\n1.2,4.0,1.5\r\n",
        "name,x (m),y (m),z (m),comment\nrx 1,4,1.5,1.2,\"by the door, left\"",
        "\"y\",\"x\",\"z\"\n\"1.5\",\"4.0\",\"1.2\"",
        ",pos_x,pos_y,pos_z\n0,4.0,1.5,1.2",
        "tx_x,tx_y,tx_z,rx_x,rx_y,rx_z\n9,9,9,4.0,1.5,1.2",
        "vx,vy,vz,x,y,z\n9,9,9,4.0,1.5,1.2",
        "lat,lon,x,y,z\n9,9,4.0,1.5,1.2",
        "PosX,posY,pos Z\n4,1.5,1.2",
        "x in m,y in m,z in m\n4,1.5,1.2",
        "# measured\n\n x , y , z \n\n# one\n 4 , 1.5 , 1.2 \n,,\n",
        "# y x z\n1.5 4 1.2",
        "# id,z,y,x\n7,1.2,1.5,4.0",
        "# x, y, z in metres\n4.0 1.5 1.2",
        "sep=;\nx;y;z\n4;1.5;1.2",
        "x,y,z\nm,m,m\n4,1.5,1.2",
        "id,x,y,z\n,[m],[m],\n1,4,1.5,1.2",
        "x,y,z,note\n4,1.5,1.2,\"two\nlines\"",
        "4\t1.5 1.2",
        "4,1.5,1.2,,",
        "x,y,z\r4,1.5,1.2\r",
    ] {
        assert_eq!(points(text), [ONE], "{text:?}");
    }
}

#[test]
fn units_are_converted_with_a_word() {
    for (text, said) in [
        ("x_cm,y_cm,z_cm\n400,150,120", "by 0.01"),
        ("x [mm],y [mm],z [mm]\n4000,1500,1200", "by 0.001"),
        ("x,y,z\nmm,mm,mm\n4000,1500,1200", "by 0.001"),
        ("x_m,y_m,z_cm\n4,1.5,120", "x by 1, y by 1, z by 0.01"),
        ("x (ft),y (ft),z (ft)\n13.123359580052494,4.921259842519685,3.937007874015748", "by 0.3048"),
    ] {
        let table = read(text, "rx.csv").unwrap();
        assert!(table.points[0].distance(ONE.into()) < 1e-12, "{text:?}: {:?}", table.points);
        assert!(table.notes.iter().any(|note| note.contains(said)), "{text:?}: {:?}", table.notes);
    }
    let table = read("# all in cm\n4,1.5,1.2", "rx.csv").unwrap();
    assert!(
        table.points == [DVec3::from(ONE)] && table.notes[0].contains("rx.csv:1") && table.notes[0].contains("cm"),
        "{table:?}"
    );
}

#[test]
fn columns_that_are_not_read_are_named_and_plain_files_have_no_words() {
    let table = read("name,x,y,z,power_dbm\na,1,2,3,-70", "rx.csv").unwrap();
    assert_eq!(table.notes, ["rx.csv: not read: name, power_dbm"]);
    for plain in ["x,y,z\n1,2,3", "x_m,y_m,z_m\nm,m,m\n1,2,3", "# in metres\n1 2 3\n4 5 6"] {
        assert_eq!(read(plain, "rx.csv").unwrap().notes, Vec::<String>::new(), "{plain}");
    }
}

#[test]
fn no_row_of_numbers_is_dropped() {
    assert_eq!(points("\"1.0\",\"1.0\",\"1.0\"\n2.0,2.0,1.5"), [[1.0; 3], [2.0, 2.0, 1.5]]);
    assert_eq!(points("# metres\n1 2 3\n-1.5\t0 1.6"), [[1.0, 2.0, 3.0], [-1.5, 0.0, 1.6]]);
    assert_eq!(points("x,y,z\n1,2,3\n\n-1.5, 0, 1.6\n"), [[1.0, 2.0, 3.0], [-1.5, 0.0, 1.6]]);
    assert_eq!(points("1e0,+2.,.5"), [[1.0, 2.0, 0.5]]);
}

#[test]
fn what_does_not_fit_is_refused_with_its_line() {
    for (text, words) in [
        ("lat,lon,alt\n1.5,4.0,1.2", &["rx.csv:1", "lat, lon, alt", "the earth"][..]),
        ("Latitude;Longitude;Height\n1;2;3", &["rx.csv:1", "Latitude"]),
        ("easting,northing,z\n1,2,3", &["rx.csv:1", "easting"]),
        ("# lat lon alt\n1 2 3", &["rx.csv:1", "lat"]),
        ("# latitude and longitude, then height\n1 2 3", &["rx.csv:1", "other columns"]),
        ("# y, x, then z, in metres\n1,2,3", &["rx.csv:1", "other columns"]),
        ("x,y\n1,2", &["rx.csv:1", "no column z"]),
        ("x,y,height\n1,2,3", &["rx.csv:1", "no column z"]),
        ("a,b,c\n1,2,3", &["rx.csv:1", "no column x, y, z"]),
        ("Receivers of the lobby\n1,2,3", &["rx.csv:1", "begin a comment with #"]),
        ("x,y,z,x\n1,2,3,4", &["columns 1 and 4 are both x"]),
        ("x,y,z\ncm,cm,furlong\n1,2,3", &["rx.csv:2", "furlong"]),
        ("x_cm,y_cm,z_cm\nm,m,m\n1,2,3", &["rx.csv:2", "another in `x_cm`"]),
        ("1,5;2,0;1,2", &["rx.csv:1", "1,5", "decimal commas"]),
        ("x;y;z\n1,5;2;1,2", &["rx.csv:2", "1,5", "decimal commas"]),
        ("1,5 2,0 1,2", &["rx.csv:1", "decimal commas"]),
        ("x\ty\tz\n1,5\t2,0\t1,2", &["rx.csv:2", "decimal commas"]),
        ("\"1,5\",\"2,0\",\"1,2\"", &["rx.csv:1", "decimal commas"]),
        ("1,5,2,0,1,2", &["rx.csv:1", "is not x, y, z"]),
        ("1,2,3\n1,2", &["rx.csv:2"]),
        ("1,2,3,4", &["rx.csv:1", "names of the columns"]),
        ("1,,2,3", &["rx.csv:1"]),
        ("1,2,3\nx,y,z", &["rx.csv:2"]),
        ("rx1,1,2,3", &["rx.csv:1", "name,x,y,z"]),
        ("x,y,z\n1,2", &["rx.csv:2", "column 3, z"]),
        ("x,y,z\n1,2,3,4", &["rx.csv:2", "4 fields"]),
        ("x,y,z\n1,,3", &["rx.csv:2", "column 2, y"]),
        ("x,y,z\n1,2,3\n1,2,NA", &["rx.csv:3", "column 3, z"]),
        ("x,y,z,n\n1,2,3,\"open\n4,5,6,b", &["rx.csv:2", "not closed"]),
        ("x,y,z,n\n1,2,3,\"a\"b", &["rx.csv:2", "closing quotation mark"]),
        ("", &["no point"]),
        ("x,y,z\n", &["no point"]),
        ("# 1,2,3\n", &["no point"]),
    ] {
        let message = read(text, "rx.csv").map(|t| t.points).unwrap_err().to_string();
        words.iter().for_each(|word| assert!(message.contains(word), "{text:?}, \"{word}\": {message}"));
    }
}

#[test]
fn any_text_is_read_or_refused() {
    let mut rng = corf_scene::Rng::keyed(7, 7, 7);
    let parts = [
        "x", "y", "z", ",", ";", "\t", " ", "\n", "\r\n", "\"", "#", "1", "-2.5", "1,5", "cm", "lat", "é", "\u{feff}", "sep=",
        "nan",
    ];
    for _ in 0..20_000 {
        let count = (rng.uniform_f64() * 24.0) as usize;
        let text: String = (0..count).map(|_| parts[(rng.uniform_f64() * parts.len() as f64) as usize]).collect();
        if let Ok(table) = read(&text, "rx.csv") {
            assert!(!table.points.is_empty(), "{text:?}");
        }
    }
}
