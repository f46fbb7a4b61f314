//! The local server: loopback only, one request after another, until Ctrl-C.

use super::routes::{self, Answer};
use super::subject::Subject;
use crate::{interrupt, note};
use anyhow::{Context, Result, anyhow, bail};
use std::io::ErrorKind;
use std::net::{Ipv4Addr, SocketAddr};
use std::time::Duration;
use tiny_http::{Header, Request, Response, Server};

/// Time after which a server that nobody asks looks for an interrupt.
const WAIT: Duration = Duration::from_millis(100);

/// Headers of every answer: nothing is kept, guessed at, framed or read by another site.
const HEADERS: [(&str, &str); 5] = [
    ("Cache-Control", "no-store"),
    ("X-Content-Type-Options", "nosniff"),
    ("X-Frame-Options", "DENY"),
    ("Cross-Origin-Resource-Policy", "same-origin"),
    ("Referrer-Policy", "no-referrer"),
];

fn bind(port: u16) -> Result<(Server, u16)> {
    let failed = |error: Box<dyn std::error::Error + Send + Sync>| {
        let kind = error.downcast_ref::<std::io::Error>().map(std::io::Error::kind);
        let help = match kind {
            Some(ErrorKind::AddrInUse) => {
                "another program listens there; choose another --port, or leave it out for one that is free"
            }
            _ => "choose another --port, or leave it out for one that is free",
        };
        anyhow!("cannot listen on 127.0.0.1:{port}: {error}\n  help: {help}")
    };
    let server = Server::http(SocketAddr::from((Ipv4Addr::LOCALHOST, port))).map_err(failed)?;
    let Some(address) = server.server_addr().to_ip() else { bail!("the server has no address") };
    Ok((server, address.port()))
}

/// Serves the viewer of a subject on 127.0.0.1 until an interrupt; port 0 is one that is free. `ready` is told the address once it answers.
///
/// # Errors
/// A port that cannot be had; what `ready` answers.
pub fn serve(subject: &mut Subject, port: u16, ready: impl FnOnce(&str) -> Result<()>) -> Result<()> {
    let (server, port) = bind(port)?;
    ready(&format!("http://127.0.0.1:{port}/"))?;
    while interrupt::check().is_ok() {
        if let Some(request) = server.recv_timeout(WAIT).context("the server cannot receive")? {
            respond(subject, port, request);
        }
    }
    Ok(())
}

fn respond(subject: &mut Subject, port: u16, request: Request) {
    let host = request.headers().iter().find(|h| h.field.equiv("Host")).map(|h| h.value.as_str());
    let Answer { status, kind, body } = routes::answer(subject, port, request.method().as_str(), request.url(), host);
    if status == 500 {
        note!("{}: {}", request.url(), String::from_utf8_lossy(&body).trim_end());
    }
    let headers = [("Content-Type", kind)].into_iter().chain(HEADERS);
    let headers = headers.filter_map(|(name, value)| Header::from_bytes(name, value).ok());
    // A body of known length is sent with its length, and in one piece.
    let whole = Response::from_data(body).with_status_code(status).with_chunked_threshold(usize::MAX);
    let response = headers.fold(whole, Response::with_header);
    // Somebody who has gone away misses nothing.
    let _ = request.respond(response);
}
