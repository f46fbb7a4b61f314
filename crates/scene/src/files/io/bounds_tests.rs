//! Files that declare what they cannot hold.

use super::text::gunzip_text;
use super::*;

/// A PNG of these chunks, their checksums made.
fn png(chunks: &[(&[u8; 4], &[u8])]) -> Vec<u8> {
    let mut bytes = b"\x89PNG\r\n\x1a\n".to_vec();
    for (kind, data) in chunks {
        bytes.extend((data.len() as u32).to_be_bytes());
        let body = [kind.as_slice(), data].concat();
        bytes.extend(&body);
        bytes.extend(crc32fast::hash(&body).to_be_bytes());
    }
    bytes
}

/// A PNG header of 8 bits a sample.
fn png_header(width: u32, height: u32, color: u8) -> Vec<u8> {
    [width.to_be_bytes().as_slice(), &height.to_be_bytes(), &[8, color, 0, 0, 0]].concat()
}

/// zlib's form of some bytes.
fn zlib(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = flate2::write::ZlibEncoder::new(Vec::new(), flate2::Compression::best());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

#[test]
fn a_palette_that_is_no_list_of_colours_is_refused_and_one_that_is_is_read() {
    let indexed = |palette: &[u8], index: u8| {
        let (header, pixels) = (png_header(1, 1, 3), zlib(&[0, index]));
        png(&[(b"IHDR", &header), (b"PLTE", palette), (b"IDAT", &pixels), (b"IEND", &[])])
    };
    assert_eq!(decode_rgba(&indexed(&[1, 2, 3, 7, 8, 9], 1), "p.png").unwrap().pixels(), [[7, 8, 9, 255]]);
    for length in [0, 1, 2, 4, 5, 767, 771] {
        let error = decode_rgba(&indexed(&vec![9; length], 0), "p.png").unwrap_err().to_string();
        assert!(error.contains("p.png") && error.contains(&format!("palette has {length} bytes")), "{error}");
    }
}

#[test]
fn sizes_are_held_against_the_bound_and_against_what_the_file_can_hold() {
    let says = |bytes: &[u8], words: &[&str]| {
        let error = decode_rgba(bytes, "big.img").unwrap_err().to_string();
        assert!(words.iter().all(|w| error.contains(w)), "{error}");
    };
    let image = |w, h| png(&[(b"IHDR", &png_header(w, h, 2)), (b"IDAT", &zlib(&[0; 64])), (b"IEND", &[])]);
    says(&image(100_000, 100_000), &["100000 x 100000 pixels (40.0 GB", "134217728 pixels"]);
    says(&image(u32::MAX, u32::MAX), &["4294967295 x 4294967295"]);
    says(&image(8000, 8000), &["8000 x 8000 pixels, which its", "bytes cannot hold"]);
    says(&image(0, 5), &["0 x 5"]);
    // A start of frame of 65 535 × 65 535, then one of 5 000 × 5 000, in 19 bytes.
    let jpeg = |n: u16| {
        let n = n.to_be_bytes();
        [b"\xff\xd8\xff\xc0\0\x0b\x08".as_slice(), &n, &n, b"\x01\x01\x11\0\xff\xda\0\x02\xff\xd9"].concat()
    };
    says(&jpeg(u16::MAX), &["65535 x 65535", "134217728 pixels"]);
    says(&jpeg(5000), &["5000 x 5000 pixels, which its", "bytes cannot hold"]);
}

#[test]
fn an_exr_that_declares_more_than_its_bytes_can_hold_is_refused_before_it_is_read() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("bomb.exr");
    let whole = encode_exr_u32(&Raster::from_fn(64, 36, |x, y| (x * y) as u32)).unwrap();
    // The data window's last row: the fourth number of the attribute; the layers' count of chunks is stated beside it.
    let at = whole.windows(10).position(|w| w == b"dataWindow").unwrap() + "dataWindow\0box2i\0".len() + 4 + 12;
    let counted = whole.windows(10).position(|w| w == b"chunkCount").map(|at| at + "chunkCount\0int\0".len() + 4);
    for (last, words) in [(268_435_456_i32, "64 x 268435457 pixels (68.7 GB"), (999_999, "64 x 1000000 pixels, which its")] {
        let mut bomb = whole.clone();
        bomb[at..at + 4].copy_from_slice(&last.to_le_bytes());
        if let Some(at) = counted {
            bomb[at..at + 4].copy_from_slice(&(last / 16 + 1).to_le_bytes());
        }
        std::fs::write(&path, bomb).unwrap();
        let error = read_exr_u32(&path).unwrap_err().to_string();
        assert!(error.contains("bomb.exr") && error.contains(words), "{error}");
    }
}

#[test]
fn gzip_that_holds_too_much_is_refused_and_members_are_read_one_after_another() {
    let bomb = gzip(&vec![b'a'; 300_000]).unwrap();
    let error = gunzip_text(&bomb[..], "b.gz", 200_000).unwrap_err().to_string();
    assert!(error.contains("b.gz") && error.contains("more than 200000 bytes"), "{error}");
    assert_eq!(gunzip_text(&bomb[..], "b.gz", 300_000).unwrap().len(), 300_000);
    let two = [gzip(b"one\n").unwrap(), gzip(b"two\n").unwrap()].concat();
    assert_eq!(gunzip_text(&two[..], "b.gz", 100).unwrap(), "one\ntwo\n");
    assert!(gunzip_text(&two[..two.len() - 1], "b.gz", 100).is_err());
    assert!(gunzip_text(&[&two[..], b"x"].concat()[..], "b.gz", 100).is_err());
}
