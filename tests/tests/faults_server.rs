//! The viewer's server with clients that are slow, many, greedy or strange: it answers those who know its token, and ends when it is to.
#![cfg(unix)]

use crate::common::*;
use crate::growing::{Growing, results};
use std::io::{ErrorKind, Read, Write};
use std::net::{Ipv6Addr, TcpListener, TcpStream};
use std::process::Command;
use std::time::{Duration, Instant};

/// Longest time in which the server or a reconstruction ends, whatever clients do; and the machine may be busy.
const LONGEST_END: Duration = Duration::from_secs(5);
/// Time in which an answer comes while others wait: well below the times that the server gives those.
const PROMPT: Duration = Duration::from_secs(5);

/// The page as whoever knows the token asks for it.
fn page(server: &Page) -> Answer {
    let start = Instant::now();
    let answer = server.try_ask("GET", "/", &server.host()).unwrap();
    assert!(start.elapsed() < PROMPT, "it took {:?}", start.elapsed());
    answer
}

/// Sends a request with the server's name in it, some lines and perhaps a body.
fn with(server: &Page, request_line: &str, lines: &[&str], body: &str) -> Answer {
    let lines: String = lines.iter().map(|line| format!("{line}\r\n")).collect();
    server.send(&format!("{request_line} HTTP/1.1\r\nHost: {}\r\n{lines}\r\n{body}", server.host())).unwrap()
}

/// Whether a client finds its connection closed, and not only quiet.
fn is_closed(client: &mut TcpStream, within: Duration) -> bool {
    let until = Instant::now() + within;
    let mut bytes = [0; 1 << 16];
    client.set_nonblocking(false).unwrap();
    while Instant::now() < until {
        client.set_read_timeout(Some(Duration::from_millis(50))).unwrap();
        match client.read(&mut bytes) {
            Ok(0) => return true,
            Ok(_) => {}
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
            Err(_) => return true,
        }
    }
    false
}

/// Clients that nobody wants: idle ones, one that has begun a request, one that knows the token and reads nothing of much that it asks for.
fn nuisances(server: &Page, idle: usize) -> Vec<TcpStream> {
    let mut clients: Vec<TcpStream> = (0..idle).map(|_| server.connect().unwrap()).collect();
    let mut begun = server.connect().unwrap();
    begun.write_all(b"GET / HTTP/1.1\r\nHo").unwrap();
    clients.push(begun);
    clients.push(greedy(server, "/"));
    clients
}

/// A client that asks for a target over and over and reads nothing: the answers fill all that lies between.
fn greedy(server: &Page, target: &str) -> TcpStream {
    let mut client = server.connect().unwrap();
    client.set_nonblocking(true).unwrap();
    let request = format!("GET {target} HTTP/1.1\r\nHost: {}\r\nCookie: {}\r\n\r\n", server.host(), server.cookie());
    // What the server does not take any more it need not be sent.
    let _ = client.write(request.repeat(500).as_bytes());
    client
}

fn signal(child: u32, name: &str) {
    assert!(Command::new("kill").args([&format!("-{name}"), &child.to_string()]).status().unwrap().success());
}

#[test]
fn a_body_is_refused_and_harms_nothing() {
    let served = Served::start(text(tiny_dataset()), &[]);
    let server = &served.page;
    let cookie = format!("Cookie: {}", server.cookie());
    for (request_line, body_line, body, status) in [
        ("GET /", "Content-Length: 5", "hello", 413),
        ("GET /data/scene", "Content-Length: 100000", "begun", 413),
        ("HEAD /", "Content-Length: 5", "hello", 413),
        ("GET /", "Transfer-Encoding: chunked", "5\r\nhello\r\n0\r\n\r\n", 413),
        ("POST /", "Content-Length: 5", "hello", 405),
        ("PUT /data/scene", "Content-Length: 5", "hello", 405),
        ("DELETE /", "Content-Length: 0", "", 405),
        ("OPTIONS /", "Content-Length: 0", "", 405),
    ] {
        // The server closes the connection, or this would wait.
        let answer = with(server, request_line, &[&cookie, body_line], body);
        assert_eq!(answer.status, status, "{request_line}, {body_line}: {}", answer.head);
        assert_eq!(answer.header("connection"), Some("close"), "{request_line}");
        assert_eq!(page(server).status, 200, "after {request_line}");
    }
}

#[test]
fn nothing_is_read_without_the_token() {
    let served = Served::start(text(tiny_dataset()), &[]);
    let server = &served.page;
    let token = &server.token;
    // One digit is another.
    let wrong = format!("{}{}", &token[..31], if token.ends_with('0') { '1' } else { '0' });
    for target in ["/", "/data/scene", "/data/field", "/data/points-optical", "/data/keyframe-1", "/none"] {
        for (query, lines) in [
            (String::new(), vec![]),
            (format!("?token={wrong}"), vec![]),
            ("?token=".to_owned(), vec![]),
            (String::new(), vec![format!("Cookie: corf-view-{}={wrong}", server.port)]),
            (String::new(), vec![format!("Cookie: corf-view-{}={token}", server.port ^ 1)]),
            (String::new(), vec![format!("Authorization: Basic {token}")]),
            (format!("?token={wrong}"), vec![format!("Cookie: {}", server.cookie())]),
        ] {
            let lines: Vec<&str> = lines.iter().map(String::as_str).collect();
            let answer = with(server, &format!("GET {target}{query}"), &lines, "");
            assert_eq!(answer.status, 403, "{target}{query} {lines:?}");
            let said = String::from_utf8(answer.body).unwrap();
            assert!(said.contains("whole address that corf has printed"), "{said}");
            assert_eq!(said.contains("<p>"), !target.starts_with("/data/"), "a page for a person, a line for a script: {said}");
            assert!(!said.contains(token.as_str()) && !answer.head.contains(token.as_str()), "it must not tell its token");
        }
    }
    // The address that was printed opens the page, and what the browser is given with it the rest.
    let opened = with(server, &format!("GET /?token={token}"), &["Connection: close"], "");
    assert_eq!(opened.status, 200);
    let given = opened.header("set-cookie").unwrap();
    assert!(given.contains("HttpOnly") && given.contains("SameSite=Strict") && !given.contains("Domain"), "{given}");
    let cookie = format!("Cookie: other=1; {}", given.split(';').next().unwrap());
    assert_eq!(with(server, "GET /data/scene", &[&cookie, "Connection: close"], "").status, 200);
    // Another viewer has another token, and another name for it.
    let second = Served::start(text(tiny_dataset()), &[]);
    assert_ne!((second.page.port, &second.page.token), (server.port, token));
    let foreign = with(&second.page, &format!("GET /?token={token}"), &[], "");
    assert_eq!(foreign.status, 403);
    let both = format!("Cookie: {}; {}", server.cookie(), second.page.cookie());
    for page in [server, &second.page] {
        assert_eq!(with(page, "GET /", &[&both, "Connection: close"], "").status, 200);
    }
}

#[test]
fn other_sites_get_nothing_and_answers_say_what_browsers_must_not_do() {
    let served = Served::start(text(tiny_dataset()), &[]);
    let server = &served.page;
    let cookie = format!("Cookie: {}", server.cookie());
    for line in [
        "Origin: http://evil.example",
        "Origin: null",
        "Sec-Fetch-Site: cross-site",
        "Sec-Fetch-Site: same-site",
        "Host: evil.example",
    ] {
        let answer = with(server, "GET /data/scene", &[&cookie, line], "");
        assert_eq!(answer.status, 403, "{line}");
        assert!(!answer.head.to_ascii_lowercase().contains("access-control"), "{}", answer.head);
    }
    let host = "evil.example";
    assert_eq!(server.try_ask("GET", "/", host).unwrap().status, 403);
    assert_eq!(server.send(&format!("GET / HTTP/1.0\r\n{cookie}\r\n\r\n")).unwrap().status, 403, "no name is not its own");
    let proxied = server.send(&format!("GET http://{host}/ HTTP/1.1\r\nHost: {}\r\n{cookie}\r\n\r\n", server.host())).unwrap();
    assert_eq!(proxied.status, 400);
    for (target, status) in [("/", 200), ("/data/scene", 200), ("/data/points-optical", 200), ("/none", 404)] {
        let answer = server.try_ask("GET", target, &server.host()).unwrap();
        assert_eq!(answer.status, status);
        let header = |name: &str| answer.header(name).unwrap_or_else(|| panic!("{target} has no {name}")).to_owned();
        assert_eq!(
            [header("x-content-type-options"), header("referrer-policy"), header("cache-control")],
            ["nosniff", "no-referrer", "no-store"]
        );
        let policy = header("content-security-policy");
        assert!(policy.contains("default-src 'none'") && policy.contains("frame-ancestors 'none'"), "{policy}");
        assert_eq!(policy.contains("script-src"), target == "/", "{policy}");
        assert!(!answer.head.to_ascii_lowercase().contains("access-control"), "{}", answer.head);
        let length: usize = header("content-length").parse().unwrap();
        let head = server.try_ask("HEAD", target, &server.host()).unwrap();
        assert_eq!((head.status, head.body.len(), answer.body.len()), (status, 0, length), "HEAD {target}");
        assert_eq!(head.header("content-length"), answer.header("content-length"));
    }
}

#[test]
fn headers_are_bounded_and_requests_behind_each_other_are_answered_in_order() {
    let served = Served::start(text(tiny_dataset()), &[]);
    let server = &served.page;
    let cookie = format!("Cookie: {}", server.cookie());
    let long = format!("X-Long: {}", "a".repeat(10_000));
    assert_eq!(with(server, "GET /", &[&cookie, &long], "").status, 431);
    assert_eq!(with(server, "GET /", &[&cookie, &long[..4000], "Connection: close"], "").status, 200);
    let target = format!("GET /?{}", "a".repeat(20_000));
    assert!([400, 414, 431].contains(&with(server, &target, &[&cookie], "").status));
    let many: Vec<String> = (0..200).map(|n| format!("X-{n}: 1")).collect();
    let many: Vec<&str> = many.iter().map(String::as_str).collect();
    assert_eq!(with(server, "GET /", &many, "").status, 431);
    // A head without an end is not read to its end.
    let mut endless = server.connect().unwrap();
    let (mut sent, line) = (0, "X-More: and more\r\n".repeat(64));
    endless.write_all(format!("GET / HTTP/1.1\r\nHost: {}\r\n", server.host()).as_bytes()).unwrap();
    while sent < 64 << 20 && endless.write_all(line.as_bytes()).is_ok() {
        sent += line.len();
    }
    assert!(sent < 64 << 20, "64 MB of headers were taken");
    // Three requests at once, the last of which closes.
    let ask = |target: &str, more: &str| format!("GET {target} HTTP/1.1\r\nHost: {}\r\n{cookie}\r\n{more}\r\n", server.host());
    let three = ask("/data/scene", "") + &ask("/none", "") + &ask("/data/keyframe-1", "Connection: close\r\n");
    let mut stream = server.connect().unwrap();
    stream.write_all(three.as_bytes()).unwrap();
    let mut all = Vec::new();
    stream.read_to_end(&mut all).unwrap();
    let all = String::from_utf8(all).unwrap();
    let statuses: Vec<&str> = all.split("HTTP/1.1 ").skip(1).map(|answer| &answer[..3]).collect();
    assert_eq!(statuses, ["200", "404", "200"]);
    // Parts of files are not given: the whole is, as RFC 9110 lets a server do.
    let ranged = with(server, "GET /data/points-optical", &[&cookie, "Range: bytes=0-9", "Connection: close"], "");
    assert!(ranged.status == 200 && ranged.body.len() > 10);
    assert_eq!(page(server).status, 200);
}

#[test]
fn slow_and_idle_clients_keep_nobody_waiting_and_are_let_go() {
    let served = Served::start(text(tiny_dataset()), &[]);
    let server = &served.page;
    let mut clients = nuisances(server, 200);
    let mut slow = server.connect().unwrap();
    let request = format!("GET /?token={} HTTP/1.1\r\nHost: {}\r\nX: {}", server.token, server.host(), "a".repeat(1000));
    let (start, mut bytes) = (Instant::now(), request.bytes());
    // Byte after byte, until nobody takes one any more; whoever asks meanwhile is answered.
    let mut asked = 0;
    while slow.write_all(&[bytes.next().unwrap()]).is_ok() && !is_closed(&mut slow, Duration::from_millis(50)) {
        asked += 1;
        if asked % 20 == 0 {
            assert_eq!(page(server).status, 200);
        }
        assert!(start.elapsed() < Duration::from_secs(30), "a slow client is kept for ever");
    }
    assert!(asked > 20 && start.elapsed() > PROMPT, "a client may take some seconds: {:?}", start.elapsed());
    // Those who are idle, who have begun or who do not read are gone as well. Who reads again in time is answered on, so the
    // last is left alone for all of its time, and the system takes some megabytes for it first, over seconds.
    std::thread::sleep(Duration::from_secs(9));
    for (n, client) in clients.iter_mut().enumerate() {
        assert!(is_closed(client, PROMPT), "client {n} is kept");
    }
    assert_eq!(page(server).status, 200);
}

#[test]
fn the_server_ends_within_five_seconds_whoever_is_connected() {
    for name in ["INT", "TERM"] {
        let mut served = Served::start(text(tiny_dataset()), &[]);
        let clients = nuisances(&served.page, 20);
        assert_eq!(page(&served.page).status, 200);
        let start = Instant::now();
        signal(served.child.id(), name);
        assert_eq!(served.child.wait().unwrap().code(), Some(0), "{name}");
        assert!(start.elapsed() < LONGEST_END, "{name}: {:?}", start.elapsed());
        drop(clients);
        assert!(served.page.connect().is_err(), "nobody listens any more");
    }
}

#[test]
fn no_client_ends_delays_or_changes_a_reconstruction() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let steps = ["--seed", "5", "--set", "iterations_per_keyframe=20"];
    let growing = Growing::start(&at("seen"), &steps);
    let server = growing.page.clone();
    let mut clients = nuisances(&server, 100);
    let refused = with(&server, "GET /", &["Content-Length: 5"], "hello");
    assert_eq!(refused.status, 413);
    assert_eq!(with(&server, "GET /data/growth?token=wrong", &[], "").status, 403);
    // Somebody looks, and does not read what it asks for, to the end and beyond.
    let finished = at("seen").join("run.json");
    let begin = Instant::now();
    while !finished.exists() {
        assert!(begin.elapsed() < PATIENCE, "it does not come to its end");
        for target in ["/data/growth", "/data/field", "/data/keyframe-1"] {
            if server.connect().is_ok() && clients.len() < 130 {
                clients.push(greedy(&server, target));
            }
        }
        std::thread::sleep(Duration::from_millis(100));
    }
    let start = Instant::now();
    assert_eq!(growing.end(), Some(0));
    assert!(start.elapsed() < LONGEST_END, "it ended {:?} after it was done", start.elapsed());
    drop(clients);
    assert!(server.connect().is_err(), "nobody listens any more");
    let unseen = at("unseen");
    corf_ok(
        &[&["reconstruct", text(tiny_dataset()), "--out", text(&unseen), "--device", "cpu", "--no-verify"], &steps[..]].concat(),
    );
    assert!(results(&at("seen")) == results(&unseen), "clients must not change a byte");
}

#[test]
fn it_listens_at_the_chosen_port_of_this_machine_alone() {
    let free = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().port();
    let served = Served::start(text(tiny_dataset()), &["--port", &free.to_string()]);
    assert_eq!(served.page.port, free);
    let named = TcpStream::connect(("localhost", free));
    assert!(named.is_ok(), "localhost is this machine: {named:?}");
    #[cfg(target_os = "linux")]
    assert!(TcpStream::connect(("127.0.0.2", free)).is_err(), "127.0.0.1 alone is listened at");
    corf_refuses(
        &["view", text(tiny_dataset()), "--no-verify", "--port", &free.to_string()],
        &[&free.to_string(), "another program listens there", "--port"],
    );
    // Where this machine has ::1, nobody else may be what localhost means.
    if let Ok(other) = TcpListener::bind((Ipv6Addr::LOCALHOST, 0)) {
        assert!(TcpStream::connect((Ipv6Addr::LOCALHOST, free)).is_ok());
        let port = other.local_addr().unwrap().port().to_string();
        let arguments = ["view", text(tiny_dataset()), "--no-verify", "--port", &port];
        corf_refuses(&arguments, &[&format!("[::1]:{port}"), "another program listens there", "--port"]);
    }
}
