//! The local server: loopback only, one request after another, until Ctrl-C or until a reconstruction ends.

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

/// A port on 127.0.0.1 that is held.
pub struct Port {
    server: Server,
    number: u16,
}

impl Port {
    /// Holds a port; 0 is one that is free. `flag` is the option of the command that chooses it.
    ///
    /// # Errors
    /// A port that cannot be had.
    pub fn hold(port: u16, flag: &str) -> Result<Self> {
        let failed = |error: Box<dyn std::error::Error + Send + Sync>| {
            let kind = error.downcast_ref::<std::io::Error>().map(std::io::Error::kind);
            let used = if kind == Some(ErrorKind::AddrInUse) { "another program listens there; " } else { "" };
            anyhow!(
                "cannot listen on 127.0.0.1:{port}: {error}\n  help: {used}choose another port with {flag}, or leave the number out for one that is free"
            )
        };
        let server = Server::http(SocketAddr::from((Ipv4Addr::LOCALHOST, port))).map_err(failed)?;
        let Some(address) = server.server_addr().to_ip() else { bail!("the server has no address") };
        Ok(Self { server, number: address.port() })
    }

    /// The address of the page.
    pub fn url(&self) -> String {
        format!("http://127.0.0.1:{}/", self.number)
    }

    /// Answers one request, if one comes within a moment.
    pub(super) fn answer_one(&self, subject: &mut Subject) -> Result<()> {
        if let Some(request) = self.server.recv_timeout(WAIT).context("the server cannot receive")? {
            respond(subject, self.number, request);
        }
        Ok(())
    }
}

/// Serves the viewer of a subject until an interrupt.
///
/// # Errors
/// A server that cannot receive any more.
pub fn serve(subject: &mut Subject, port: &Port) -> Result<()> {
    while interrupt::check().is_ok() {
        port.answer_one(subject)?;
    }
    Ok(())
}

fn respond(subject: &mut Subject, port: u16, request: Request) {
    let host = request.headers().iter().find(|h| h.field.equiv("Host")).map(|h| h.value.as_str());
    let Answer { status, kind, body, version } = routes::answer(subject, port, request.method().as_str(), request.url(), host);
    if status == 500 {
        note!("{}: {}", request.url(), String::from_utf8_lossy(&body).trim_end());
    }
    let headers = [("Content-Type", kind)].into_iter().chain(HEADERS);
    let tag = version.map(|version| Header::from_bytes("ETag", format!("\"{version}\"")));
    let headers = headers.map(|(name, value)| Header::from_bytes(name, value)).chain(tag).flatten();
    // A body of known length is sent with its length, and in one piece.
    let whole = Response::from_data(body).with_status_code(status).with_chunked_threshold(usize::MAX);
    let response = headers.fold(whole, Response::with_header);
    // Somebody who has gone away misses nothing.
    let _ = request.respond(response);
}
