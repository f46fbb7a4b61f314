//! Runs the command as a user does, on a lobby small enough for a test.

#![allow(dead_code, clippy::unwrap_used)]

#[path = "../../shared.rs"]
mod reference_data;
#[allow(unused_imports)]
pub use reference_data::shared;

use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Output, Stdio};
use std::sync::OnceLock;
use std::time::{Duration, Instant};

/// The workspace's root.
pub fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

/// The command with arguments, not started yet.
pub fn command(arguments: &[&str]) -> Command {
    let mut command = Command::new(env!("CARGO_BIN_EXE_corf-under-test"));
    command.args(arguments).current_dir(root()).stdin(Stdio::null());
    command
}

/// Runs the command to its end.
pub fn corf(arguments: &[&str]) -> Output {
    command(arguments).output().unwrap()
}

/// Runs the command and insists on exit code 0; returns standard output.
pub fn corf_ok(arguments: &[&str]) -> String {
    let output = corf(arguments);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(0), "corf {arguments:?}\n{stderr}");
    String::from_utf8(output.stdout).unwrap()
}

/// Runs the command and insists on exit code 2 and on words in the message.
pub fn corf_refuses(arguments: &[&str], words: &[&str]) {
    let output = corf(arguments);
    let stderr = String::from_utf8_lossy(&output.stderr);
    assert_eq!(output.status.code(), Some(2), "corf {arguments:?}\n{stderr}");
    for word in words {
        assert!(stderr.contains(word), "corf {arguments:?} does not say \"{word}\":\n{stderr}");
    }
    assert!(!stderr.contains("panicked"), "{stderr}");
}

/// Starts the command in the background, its messages thrown away.
pub fn start(arguments: &[&str]) -> Child {
    command(arguments).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
}

/// Longest wait for a command to come to the point where it is interrupted.
pub const PATIENCE: Duration = Duration::from_secs(180);

/// Starts a command, interrupts it when `ready` says so, and returns its exit code (`None` when it finished before).
pub fn interrupt_when(arguments: &[&str], ready: impl Fn() -> bool) -> Option<i32> {
    let mut child = start(arguments);
    let begin = Instant::now();
    while !ready() && child.try_wait().unwrap().is_none() {
        assert!(begin.elapsed() < PATIENCE, "corf {arguments:?} did not come to the point");
        std::thread::sleep(Duration::from_millis(2));
    }
    let kill = std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    let code = child.wait().unwrap().code();
    if kill.success() { code } else { None }
}

/// The address of a viewer's page on this machine.
#[derive(Clone)]
pub struct Page {
    pub port: u16,
    pub token: String,
}

impl Page {
    /// The parts of an address that was printed.
    pub fn of(url: &str) -> Self {
        let rest = url.strip_prefix("http://127.0.0.1:").unwrap_or_else(|| panic!("{url} is no address of this machine"));
        let (port, token) = rest.split_once("/?token=").unwrap_or_else(|| panic!("{url} has no token"));
        assert!(token.len() == 32 && token.bytes().all(|b| b.is_ascii_hexdigit()), "{url}");
        Self { port: port.parse().unwrap(), token: token.to_owned() }
    }

    /// The server's own name.
    pub fn host(&self) -> String {
        format!("127.0.0.1:{}", self.port)
    }

    /// The cookie that a browser sends.
    pub fn cookie(&self) -> String {
        format!("corf-view-{}={}", self.port, self.token)
    }

    /// A connection.
    pub fn connect(&self) -> std::io::Result<TcpStream> {
        let stream = TcpStream::connect(("127.0.0.1", self.port))?;
        stream.set_read_timeout(Some(PATIENCE))?;
        Ok(stream)
    }

    /// Asks as a browser does that knows the token.
    pub fn try_ask(&self, method: &str, target: &str, host: &str) -> std::io::Result<Answer> {
        let cookie = self.cookie();
        self.send(&format!("{method} {target} HTTP/1.1\r\nHost: {host}\r\nCookie: {cookie}\r\nConnection: close\r\n\r\n"))
    }

    /// Sends a request as it stands, and reads until the server closes the connection.
    pub fn send(&self, request: &str) -> std::io::Result<Answer> {
        let mut stream = self.connect()?;
        stream.write_all(request.as_bytes())?;
        let mut answer = Vec::new();
        stream.read_to_end(&mut answer)?;
        Answer::of(&answer).ok_or(std::io::ErrorKind::UnexpectedEof.into())
    }
}

/// An answer of a server.
pub struct Answer {
    pub status: u16,
    pub head: String,
    pub body: Vec<u8>,
}

impl Answer {
    /// The parts of an answer; none of one that is cut short within its head.
    fn of(bytes: &[u8]) -> Option<Self> {
        let end = bytes.windows(4).position(|w| w == b"\r\n\r\n")?;
        let head = String::from_utf8(bytes[..end].to_vec()).unwrap();
        let status = head.split(' ').nth(1).unwrap().parse().unwrap();
        Some(Self { status, head, body: bytes[end + 4..].to_vec() })
    }

    /// The value of a header.
    pub fn header(&self, name: &str) -> Option<&str> {
        let lines = self.head.lines().skip(1).filter_map(|line| line.split_once(": "));
        lines.filter(|(n, _)| n.eq_ignore_ascii_case(name)).map(|(_, value)| value.trim()).next()
    }

    /// The body as JSON.
    pub fn json(&self) -> serde_json::Value {
        serde_json::from_slice(&self.body).unwrap()
    }
}

/// `corf view --json` at work; ended when it goes out of scope.
pub struct Served {
    pub child: Child,
    pub page: Page,
}

impl Served {
    pub fn start(folder: &str, more: &[&str]) -> Self {
        let arguments = [&["view", folder, "--no-verify", "--json"], more].concat();
        let mut child = command(&arguments).stdout(Stdio::piped()).stderr(Stdio::null()).spawn().unwrap();
        let mut said = String::new();
        let mut lines = BufReader::new(child.stdout.take().unwrap());
        while !said.contains('}') {
            assert!(lines.read_line(&mut said).unwrap() > 0, "it ended: {said}");
        }
        let url = serde_json::from_str::<serde_json::Value>(&said).unwrap()["url"].as_str().unwrap().to_owned();
        Self { child, page: Page::of(&url) }
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

/// A path as an argument.
pub fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// A dataset configuration of the lobby in very small, with the few light paths of tests that do not look at images.
pub fn tiny_config(folder: &Path, keyframes: usize) -> PathBuf {
    write_tiny(folder, keyframes, "method = \"path\"\nsamples_per_pixel = 2\nmax_bounces = 3\n")
}

/// As [`tiny_config`], with light worked out as datasets have it by default.
pub fn tiny_cached_config(folder: &Path, keyframes: usize) -> PathBuf {
    write_tiny(folder, keyframes, "")
}

fn write_tiny(folder: &Path, keyframes: usize, light: &str) -> PathBuf {
    let scene = root().join("scenes/lobby.toml").canonicalize().unwrap();
    let path = folder.join("tiny.toml");
    let body = format!(
        "name = \"tiny\"\nscene = {scene:?}\nkeyframes = {keyframes}\nseed = 3\n\
         [optical]\nwidth = 96\nheight = 54\n{light}\
         [rf]\nwidth = 48\nheight = 32\npatch_size_m = 0.4\n"
    );
    std::fs::write(&path, body).unwrap();
    path
}

/// A tiny dataset, generated once for all test programs that stand beside one build of the command.
pub fn tiny_dataset() -> &'static Path {
    static DATASET: OnceLock<PathBuf> = OnceLock::new();
    DATASET.get_or_init(|| {
        let scratch = Path::new(env!("CARGO_TARGET_TMPDIR"));
        let inputs = [
            PathBuf::from(env!("CARGO_BIN_EXE_corf-under-test")),
            root().join("scenes/lobby.toml"),
            root().join("scenes/lobby.glb"),
        ];
        let changed = inputs.map(|file| std::fs::metadata(file).unwrap().modified().unwrap());
        let newest = changed.iter().max().unwrap().duration_since(std::time::UNIX_EPOCH).unwrap().as_nanos();
        let place = scratch.join(format!("tiny-{newest}"));
        if !place.join("dataset.json").exists() {
            let folder = tempfile::tempdir_in(scratch).unwrap();
            let config = tiny_cached_config(folder.path(), 10);
            let out = folder.path().join("dataset");
            corf_ok(&["dataset", "generate", text(&config), "--out", text(&out)]);
            // Another test program may have been faster.
            assert!(std::fs::rename(&out, &place).is_ok() || place.join("dataset.json").exists());
        }
        place
    })
}

/// Copies a folder with everything in it.
pub fn copy_folder(from: &Path, to: &Path) {
    std::fs::create_dir_all(to).unwrap();
    for entry in std::fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let target = to.join(entry.file_name());
        if entry.file_type().unwrap().is_dir() {
            copy_folder(&entry.path(), &target);
        } else {
            std::fs::copy(entry.path(), target).unwrap();
        }
    }
}

/// Boxes of a Wavefront file: name, material, smallest and largest corner, and which faces there are (−x, +x, −y, +y, −z, +z).
pub type Boxes<'b> = &'b [(&'b str, &'b str, [f64; 3], [f64; 3], [bool; 6])];

/// All faces of a box.
pub const CLOSED: [bool; 6] = [true; 6];

/// Writes a scene of boxes with plasterboard, concrete (`pillar`) and glass (`pane`), and returns its scene file; `extra` goes behind.
pub fn boxes_scene(folder: &Path, boxes: Boxes<'_>, tx: [f64; 3], extra: &str) -> PathBuf {
    let (mut obj, mut first) = (String::from("mtllib room.mtl\n"), 1);
    for (name, material, min, max, faces) in boxes {
        obj += &format!("o {name}\nusemtl {material}\n");
        for i in 0..8 {
            let corner: Vec<f64> = (0..3).map(|k| if i >> k & 1 > 0 { max[k] } else { min[k] }).collect();
            obj += &format!("v {} {} {}\n", corner[0], corner[1], corner[2]);
        }
        let quads = [[0, 4, 6, 2], [1, 3, 7, 5], [0, 1, 5, 4], [2, 6, 7, 3], [0, 2, 3, 1], [4, 5, 7, 6]];
        for (q, _) in quads.iter().zip(faces).filter(|(_, on)| **on) {
            obj += &format!("f {} {} {} {}\n", q[0] + first, q[1] + first, q[2] + first, q[3] + first);
        }
        first += 8;
    }
    std::fs::write(folder.join("room.obj"), &obj).unwrap();
    std::fs::write(folder.join("room.mtl"), "newmtl wall\nKd 1 1 1\nnewmtl stone\nKd 1 1 1\nnewmtl pane\nKd 1 1 1\n").unwrap();
    let mut materials = String::new();
    for (name, itu, thickness_m) in [("wall", "plasterboard", 0.013), ("stone", "concrete", 0.1), ("pane", "glass", 0.004)] {
        if obj.contains(&format!("usemtl {name}\n")) {
            materials += &format!(
                "[radio_materials.{name}]\nid = \"{itu}\"\nitu = \"{itu}\"\nthickness_m = {thickness_m}\nscattering_coefficient = 0.3\n"
            );
        }
    }
    let path = folder.join("room.toml");
    let text = format!("[scene]\nfile = \"room.obj\"\n[transmitter]\nposition_m = {tx:?}\n{materials}{extra}");
    std::fs::write(&path, text).unwrap();
    path
}

/// A room of 6 × 5 × 3 m with a pillar.
pub fn room_with_pillar(folder: &Path, tx: [f64; 3], extra: &str) -> PathBuf {
    let boxes: Boxes<'_> =
        &[("room", "wall", [0.0; 3], [6.0, 5.0, 3.0], CLOSED), ("pillar", "stone", [2.0, 2.0, 0.0], [2.6, 2.6, 3.0], CLOSED)];
    boxes_scene(folder, boxes, tx, extra)
}
