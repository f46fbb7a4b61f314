//! What is there for people who denoise: Intel Open Image Denoise where it is installed, and a denoiser's guides as files.
//!
//! The filter itself is not part of the project: `CORF_OIDN_LIBRARY=…/libOpenImageDenoise.so.2 cargo test --release -p corf-tests
//! denoiser -- --ignored` runs what needs it.

use crate::common::{command, corf_ok, corf_refuses, root, text};
use corf_bench::metrics::image::psnr;
use corf_scene::dataset::Dataset;
use std::path::{Path, PathBuf};

const LIBRARY: &str = "CORF_OIDN_LIBRARY";
const GUIDES: &str = "write_albedo = true\nwrite_normals = true\nwrite_depth_png = true\nwrite_linear = true\n";

/// A dataset configuration of two small views of the plain room.
fn config(folder: &Path, name: &str, light: &str) -> PathBuf {
    let scene = root().join("scenes/room.toml").canonicalize().unwrap();
    let path = folder.join(format!("{name}.toml"));
    let body = format!(
        "name = \"{name}\"\nscene = {scene:?}\nkeyframes = 2\n[optical]\nwidth = 96\nheight = 54\nexposure_ev = 0.0\n{light}\n\
         [rf]\nwidth = 12\nheight = 8\ndiffuse = false\n"
    );
    std::fs::write(&path, body).unwrap();
    path
}

fn generate(folder: &Path, name: &str, light: &str) -> Dataset {
    let out = folder.join(format!("{name}-out"));
    corf_ok(&["dataset", "generate", text(&config(folder, name, light)), "--out", text(&out)]);
    corf_ok(&["dataset", "validate", text(&out)]);
    Dataset::open(out).unwrap()
}

#[test]
fn a_denoiser_that_is_not_there_is_told_before_anything_is_made() {
    let folder = tempfile::tempdir().unwrap();
    let path = config(folder.path(), "none", "method = \"path\"\nsamples_per_pixel = 2\ndenoiser = \"oidn\"\n");
    let out = folder.path().join("out");
    let refused = command(&["dataset", "generate", text(&path), "--out", text(&out)])
        .env(LIBRARY, folder.path().join("libOpenImageDenoise.so.2"))
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&refused.stderr);
    assert_eq!(refused.status.code(), Some(2), "{said}");
    for word in ["optical.denoiser", "cannot be loaded", "pip install pyoidn", LIBRARY] {
        assert!(said.contains(word), "no {word} in {said}");
    }
    assert!(!out.exists());

    let cached = config(folder.path(), "cached", "denoiser = \"oidn\"\n");
    corf_refuses(&["dataset", "generate", text(&cached), "--out", text(&out)], &["optical.denoiser", "method = \"path\""]);
}

#[test]
fn guides_and_millimetres_are_what_is_seen() {
    let folder = tempfile::tempdir().unwrap();
    for (name, method) in [("cached", ""), ("path", "method = \"path\"\nsamples_per_pixel = 8\n")] {
        let dataset = generate(folder.path(), name, &format!("{method}{GUIDES}"));
        let [albedo, normals] = dataset.guides(1).unwrap().map(Option::unwrap);
        assert!(albedo.pixels().iter().flatten().all(|a| (0.0..=1.0).contains(a)));
        // The room's faces look along the axes: where a pixel sees one alone, so does its normal.
        let length = |n: &[f32; 3]| n.iter().map(|c| c * c).sum::<f32>().sqrt();
        let whole: Vec<&[f32; 3]> = normals.pixels().iter().filter(|n| length(n) > 0.9999).collect();
        assert!(whole.len() > 96 * 54 / 2, "{} of the pixels see one face", whole.len());
        assert!(whole.iter().all(|n| n.iter().any(|c| c.abs() > 0.999)));
        // Plaster is plaster, all over the wall that fills most of the view.
        let plaster = albedo.pixels().iter().filter(|a| (a[0] - 0.8).abs() < 0.02 && (a[2] - 0.76).abs() < 0.02).count();
        assert!(plaster > 500, "{plaster} pixels of plaster");
        let file = image::open(dataset.dir().join("optical/depth_mm/00002_depth.png")).unwrap();
        let image::DynamicImage::ImageLuma16(millimetres) = file else { panic!("not 16-bit grey") };
        let depth_m = dataset.keyframe(1).unwrap().light.unwrap().depth_m.unwrap();
        assert!(depth_m.pixels().iter().zip(millimetres.as_raw()).all(|(m, mm)| (1e3 * m - f32::from(*mm)).abs() <= 0.501));
    }
}

#[test]
#[ignore = "needs Intel Open Image Denoise 2, named by CORF_OIDN_LIBRARY"]
fn the_filter_takes_noise_and_leaves_the_light() {
    let folder = tempfile::tempdir().unwrap();
    let path =
        |samples: u32, more: &str| format!("method = \"path\"\nsamples_per_pixel = {samples}\nwrite_linear = true\n{more}");
    let converged = generate(folder.path(), "converged", &path(2048, ""));
    let noisy = generate(folder.path(), "noisy", &path(16, ""));
    let clean = generate(folder.path(), "clean", &path(16, "denoiser = \"oidn\"\n"));
    assert!(clean.header().denoiser.as_ref().unwrap().starts_with("Intel Open Image Denoise 2."));
    assert!(clean.conventions()["optical"]["light"].contains("Intel Open Image Denoise"));
    let image = |set: &Dataset| set.keyframe(0).unwrap().light.unwrap().image;
    let (before, after) = (psnr(&image(&noisy), &image(&converged), None), psnr(&image(&clean), &image(&converged), None));
    assert!(after > before + 6.0, "{before:.1} dB became {after:.1} dB");
    let mean = |set: &Dataset| {
        let linear = set.linear(0).unwrap().unwrap();
        linear.pixels().iter().flatten().map(|v| f64::from(*v)).sum::<f64>()
    };
    let ratio = mean(&clean) / mean(&converged);
    assert!((ratio - 1.0).abs() < 0.03, "{ratio} of the light is left");
    let again = generate(folder.path(), "again", &path(16, "denoiser = \"oidn\"\n"));
    assert_eq!(image(&again), image(&clean));
}
