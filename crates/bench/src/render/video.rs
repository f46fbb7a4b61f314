//! A video of rendered pictures, by `ffmpeg` where it is on PATH. The pictures stay, so nothing is lost with the video.

use anyhow::{Context, Result, bail, ensure};
use corf_scene::io::ScratchFolder;
use std::ffi::OsString;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};

/// Program that encodes.
const FFMPEG: &str = "ffmpeg";

/// Kind of a video, by the ending of its name.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Mp4,
    Gif,
}

/// A video to be made.
#[derive(Clone, Debug, PartialEq)]
pub struct Video {
    file: PathBuf,
    kind: Kind,
    frames_per_second: f64,
}

impl Video {
    /// A video of this name; `ffmpeg` is looked for, so that what cannot be made is known before anything is rendered.
    ///
    /// # Errors
    /// Another ending than `.mp4` or `.gif`, a rate out of range, no ffmpeg on PATH.
    pub fn plan(file: &Path, frames_per_second: f64) -> Result<Self> {
        let kind = match file.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).as_deref() {
            Some("mp4") => Kind::Mp4,
            Some("gif") => Kind::Gif,
            _ => bail!("--video {}: it is neither .mp4 nor .gif\n  help: name it so", file.display()),
        };
        // A GIF counts hundredths of a second.
        let most = if kind == Kind::Gif { 50.0 } else { 240.0 };
        ensure!(
            (0.1..=most).contains(&frames_per_second),
            "--fps {frames_per_second} is out of range\n  help: give 0.1 to {most} frames per second"
        );
        version()?;
        Ok(Self { file: file.to_owned(), kind, frames_per_second })
    }

    /// Encodes the pictures `FOLDER/00001.png` to `count`, in order; the file is there whole or not at all.
    ///
    /// # Errors
    /// ffmpeg's, with its words; a video of another number of frames.
    pub fn encode(&self, folder: &Path, count: usize) -> Result<()> {
        let file = std::path::absolute(&self.file)?;
        let beside = file.parent().unwrap_or(Path::new("."));
        let scratch = ScratchFolder::beside(beside).with_context(|| format!("cannot write beside {}", file.display()))?;
        let temporary = scratch.path().join(if self.kind == Kind::Mp4 { "video.mp4" } else { "video.gif" });
        // From their folder: its name may hold what ffmpeg takes for a pattern.
        let output = Command::new(FFMPEG)
            .args(self.arguments(count, &temporary))
            .current_dir(folder)
            .stdin(Stdio::null())
            .output()
            .with_context(|| format!("cannot start {FFMPEG}"))?;
        let complaint = String::from_utf8_lossy(&output.stderr).trim().to_owned();
        ensure!(
            output.status.success(),
            "{FFMPEG} made no {} ({}): {complaint}\n  help: the pictures are in {}",
            self.file.display(),
            output.status,
            folder.display()
        );
        let encoded = frames_of(&String::from_utf8_lossy(&output.stdout));
        ensure!(
            encoded == Some(count),
            "{FFMPEG} says that it encoded {} frames of {count}; no video was kept\n  help: the pictures are in {}",
            encoded.map_or("an unknown number of".to_owned(), |n| n.to_string()),
            folder.display()
        );
        std::fs::rename(&temporary, &file).with_context(|| format!("cannot write {}", file.display()))
    }

    /// One picture a frame; options that every ffmpeg since 4 knows.
    fn arguments(&self, count: usize, out: &Path) -> Vec<OsString> {
        let mut list: Vec<OsString> = Vec::new();
        let mut put = |words: &[&str]| list.extend(words.iter().map(OsString::from));
        put(&["-y", "-nostdin", "-loglevel", "error", "-progress", "pipe:1"]);
        put(&["-framerate", &self.frames_per_second.to_string(), "-start_number", "1", "-i", "%05d.png"]);
        put(&["-frames:v", &count.to_string()]);
        match self.kind {
            // The widest-read form of H.264 has even sides.
            Kind::Mp4 => put(&[
                "-vf",
                "pad=ceil(iw/2)*2:ceil(ih/2)*2",
                "-c:v",
                "libx264",
                "-crf",
                "16",
                "-pix_fmt",
                "yuv420p",
                "-movflags",
                "+faststart",
            ]),
            Kind::Gif => put(&["-vf", "split[a][b];[a]palettegen=stats_mode=full[p];[b][p]paletteuse", "-loop", "0"]),
        }
        list.push(out.as_os_str().to_owned());
        list
    }
}

/// The first line of `ffmpeg -version`.
///
/// # Errors
/// It is not on PATH, or does not start.
pub fn version() -> Result<String> {
    let output = Command::new(FFMPEG).arg("-version").stdin(Stdio::null()).stderr(Stdio::null()).output();
    match output {
        Ok(output) if output.status.success() => {
            Ok(String::from_utf8_lossy(&output.stdout).lines().next().unwrap_or(FFMPEG).to_owned())
        }
        Ok(output) => bail!("`{FFMPEG} -version` ended with {}\n  help: install another ffmpeg", output.status),
        Err(_) => bail!(
            "videos are made by {FFMPEG}, which is not on PATH\n  help: install it, or leave --video out and use the pictures"
        ),
    }
}

/// The last number of frames that ffmpeg's progress report gives.
fn frames_of(progress: &str) -> Option<usize> {
    progress.lines().rev().find_map(|line| line.trim().strip_prefix("frame=")?.trim().parse().ok())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn progress_is_read_to_its_end() {
        assert_eq!(frames_of("frame=3\nfps=0.0\nprogress=continue\nframe=12\nfps=9\nprogress=end\n"), Some(12));
        assert_eq!(frames_of("progress=end\n"), None);
    }

    #[test]
    fn other_endings_and_rates_are_refused() {
        for (file, rate, word) in
            [("a.avi", 30.0, ".gif"), ("a", 30.0, ".mp4"), ("a.gif", 60.0, "50"), ("a.mp4", f64::NAN, "240")]
        {
            let error = Video::plan(Path::new(file), rate).unwrap_err().to_string();
            assert!(error.contains(word) && error.contains("help"), "{file}: {error}");
        }
    }
}
