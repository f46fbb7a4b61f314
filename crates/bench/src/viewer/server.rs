//! The local server: loopback only, on a thread of its own that does nothing but speak to browsers. What they ask for is made elsewhere, one
//! job after another, so that no client keeps anybody waiting; headers, connections and times are bounded.

use super::connection::{ANSWERING, Standing, Stream, Whole};
use super::guard::{Asked, Guard, Refusal, Token};
use super::routes::{Answer, Desk};
use super::subject::Subject;
use crate::note;
use crate::terminal::interrupt;
use anyhow::{Context, Result, anyhow, bail};
use hyper::body::{Body, Incoming};
use hyper::header::{ALLOW, CONNECTION, CONTENT_SECURITY_POLICY, CONTENT_TYPE, ETAG, HeaderName, HeaderValue, SET_COOKIE};
use hyper::server::conn::http1;
use hyper::service::service_fn;
use hyper::{Request, Response, StatusCode};
use std::convert::Infallible;
use std::future::{Future, poll_fn};
use std::io::ErrorKind;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, SocketAddr, TcpListener};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::pin::pin;
use std::sync::Arc;
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, SyncSender, TrySendError};
use std::task::Poll;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};
use tokio::net::TcpStream;
use tokio::sync::{oneshot, watch};
use tokio::task::JoinHandle as Task;
use tokio::time::{sleep, sleep_until, timeout, timeout_at};

/// Most bytes of a request's line and headers.
const HEAD_BYTES: usize = 8 << 10;
/// Most headers of a request.
const HEADERS: usize = 64;
/// Bytes that a connection keeps of what it is sent and of what it sends.
const BUFFER_BYTES: usize = 16 << 10;
/// Most connections: one more takes the place of the oldest that has not shown the token, or of none.
const CONNECTIONS: usize = 64;
/// Most jobs that wait for the program.
const JOBS: usize = CONNECTIONS;
/// Free ports that are tried, where one is free on one of this machine's names alone.
const TRIES: usize = 16;

/// Time after which a server that nobody asks looks for an interrupt.
const WAIT: Duration = Duration::from_millis(100);
/// Pause after a connection that could not be taken: the process may have no descriptor left.
const PAUSE: Duration = Duration::from_millis(50);
/// Time for answers under way when the program is interrupted.
const LAST_ANSWERS: Duration = Duration::from_millis(500);
/// Longest wait for the server's thread beside the time that it is given.
const LAST_WAIT: Duration = Duration::from_millis(500);

/// Headers of every answer: nothing is kept, guessed at, framed, opened beside or read by another site.
const FIXED: [(&str, &str); 7] = [
    ("cache-control", "no-store"),
    ("x-content-type-options", "nosniff"),
    ("x-frame-options", "DENY"),
    ("cross-origin-resource-policy", "same-origin"),
    ("cross-origin-opener-policy", "same-origin"),
    ("referrer-policy", "no-referrer"),
    ("x-robots-tag", "none"),
];

/// A port on this machine's own addresses that is held, and the token that opens what is served there.
pub struct Port {
    listeners: Vec<TcpListener>,
    guard: Guard,
}

impl Port {
    /// Holds a port; 0 is one that is free. `flag` is the option of the command that chooses it. It is held on 127.0.0.1 and, where this machine
    /// has it, on ::1: `localhost` may mean either, and nobody else is to answer there.
    ///
    /// # Errors
    /// A port that cannot be had.
    pub fn hold(port: u16, flag: &str) -> Result<Self> {
        let mut tries = 0;
        loop {
            let first = listen(Ipv4Addr::LOCALHOST.into(), port).map_err(|error| refused("127.0.0.1", port, flag, &error))?;
            let number = first.local_addr().context("the server has no address")?.port();
            let mut listeners = vec![first];
            match listen(Ipv6Addr::LOCALHOST.into(), number) {
                Ok(second) => listeners.push(second),
                Err(error) if error.kind() == ErrorKind::AddrInUse => {
                    tries += 1;
                    if port == 0 && tries < TRIES {
                        continue;
                    }
                    return Err(refused("[::1]", number, flag, &error));
                }
                // This machine has no IPv6.
                Err(_) => {}
            }
            return Ok(Self { listeners, guard: Guard::new(number, Token::draw()?) });
        }
    }

    /// The address of the page, with its token.
    pub fn url(&self) -> String {
        self.guard.url()
    }

    /// Serves on a thread of its own; what is asked for comes as jobs.
    ///
    /// # Errors
    /// The system gives no thread or no means to wait for connections.
    pub(super) fn open(self) -> Result<(Server, Receiver<Job>)> {
        let (jobs, receiver) = mpsc::sync_channel(JOBS);
        let (end, ending) = watch::channel(None);
        let (over, is_over) = mpsc::channel::<()>();
        let runtime = tokio::runtime::Builder::new_current_thread().enable_io().enable_time().build();
        let runtime = runtime.context("the viewer's server cannot wait for connections")?;
        let hall = Arc::new(Hall { guard: self.guard, jobs });
        let listeners = {
            let _within = runtime.enter();
            let listeners = self.listeners.into_iter().map(tokio::net::TcpListener::from_std);
            listeners.collect::<std::io::Result<Vec<_>>>().context("the viewer's server cannot listen")?
        };
        let serve = move || {
            // A panic ends the server and nothing else; what was said of it is the panic's own message.
            if catch_unwind(AssertUnwindSafe(|| runtime.block_on(receive(&listeners, &hall, ending)))).is_err() {
                note!("the viewer's server has failed: nobody can look any more");
            }
            drop((runtime, listeners, over));
        };
        let thread = std::thread::Builder::new().name("view-server".to_owned()).spawn(serve);
        Ok((Server { end, is_over, thread: Some(thread.context("the viewer's server gets no thread")?) }, receiver))
    }
}

fn listen(address: IpAddr, port: u16) -> std::io::Result<TcpListener> {
    let listener = TcpListener::bind(SocketAddr::from((address, port)))?;
    listener.set_nonblocking(true)?;
    Ok(listener)
}

fn refused(host: &str, port: u16, flag: &str, error: &std::io::Error) -> anyhow::Error {
    let why = match error.kind() {
        ErrorKind::AddrInUse => "another program listens there; ",
        ErrorKind::PermissionDenied => "ports below 1024 may be reserved to the system; ",
        _ => "",
    };
    anyhow!(
        "cannot listen on {host}:{port}: {error}\n  help: {why}choose another port with {flag}, or leave the number out for one that is free"
    )
}

/// A server at work; it ends when it goes out of scope.
pub(super) struct Server {
    end: watch::Sender<Option<Instant>>,
    is_over: Receiver<()>,
    thread: Option<JoinHandle<()>>,
}

impl Server {
    /// Takes no connection any more, gives answers under way until then, and ends. It never takes longer than half a second beyond.
    pub(super) fn end(mut self, until: Instant) {
        self.end_by(until);
    }

    fn end_by(&mut self, until: Instant) {
        let Some(thread) = self.thread.take() else { return };
        let _ = self.end.send(Some(until));
        let within = until.saturating_duration_since(Instant::now()) + LAST_WAIT;
        // A thread that does not end in time is left to the end of the process: it holds nothing that anybody waits for.
        if self.is_over.recv_timeout(within) == Err(RecvTimeoutError::Disconnected) {
            let _ = thread.join();
        }
    }
}

impl Drop for Server {
    fn drop(&mut self) {
        self.end_by(Instant::now());
    }
}

/// What one request asks of the program.
pub(super) struct Job {
    target: String,
    reply: oneshot::Sender<Answer>,
}

impl Job {
    /// Makes its answer, unless the client has gone; what goes wrong, a panic too, is an answer and is noted.
    pub(super) fn answer(self, desk: &mut Desk<'_>) {
        if self.reply.is_closed() {
            return;
        }
        let answer = catch_unwind(AssertUnwindSafe(|| desk.answer(&self.target)))
            .unwrap_or_else(|_| Answer::text(500, "the program has failed at this: its messages say where"));
        if answer.status == 500 {
            let path = self.target.split('?').next().unwrap_or_default();
            note!("{path}: {}", String::from_utf8_lossy(&answer.body).trim_end());
        }
        // Somebody who has gone away misses nothing.
        let _ = self.reply.send(answer);
    }
}

/// Serves the viewer of a subject until an interrupt.
///
/// # Errors
/// A server that cannot be started, or that has failed.
pub fn serve(subject: &mut Subject, port: Port) -> Result<()> {
    let (server, jobs) = port.open()?;
    let mut desk = Desk::new(subject);
    while interrupt::check().is_ok() {
        match jobs.recv_timeout(WAIT) {
            Ok(job) => job.answer(&mut desk),
            Err(RecvTimeoutError::Timeout) => {}
            Err(RecvTimeoutError::Disconnected) => bail!("the viewer's server has ended by itself"),
        }
    }
    server.end(Instant::now() + LAST_ANSWERS);
    Ok(())
}

/// What all connections share.
struct Hall {
    guard: Guard,
    jobs: SyncSender<Job>,
}

/// A connection and its task.
struct Guest {
    task: Task<()>,
    standing: Arc<Standing>,
}

/// Takes connections until the end is said, and sees those that are answered out.
async fn receive(listeners: &[tokio::net::TcpListener], hall: &Arc<Hall>, mut ending: watch::Receiver<Option<Instant>>) {
    let mut guests: Vec<Guest> = Vec::new();
    let reported = ending.clone();
    {
        // Without anybody who could say it, this is the end as well.
        let mut end = pin!(ending.wait_for(Option::is_some));
        loop {
            let next = poll_fn(|cx| {
                if end.as_mut().poll(cx).is_ready() {
                    return Poll::Ready(None);
                }
                listeners
                    .iter()
                    .find_map(|l| match l.poll_accept(cx) {
                        Poll::Ready(taken) => Some(Poll::Ready(Some(taken))),
                        Poll::Pending => None,
                    })
                    .unwrap_or(Poll::Pending)
            });
            match next.await {
                None => break,
                // The client has gone again, or the process has no descriptor left; either passes.
                Some(Err(_)) => sleep(PAUSE).await,
                Some(Ok((stream, _))) => admit(stream, hall, &reported, &mut guests),
            }
        }
    }
    let until = ending.borrow().unwrap_or_else(Instant::now);
    let answered = async {
        for guest in &mut guests {
            let _ = (&mut guest.task).await;
        }
    };
    let _ = timeout_at(until.into(), answered).await;
    guests.iter().for_each(|guest| guest.task.abort());
}

/// Gives a connection a task; where there are too many, the oldest goes that has not shown the token.
fn admit(stream: TcpStream, hall: &Arc<Hall>, ending: &watch::Receiver<Option<Instant>>, guests: &mut Vec<Guest>) {
    guests.retain(|guest| !guest.task.is_finished());
    if guests.len() >= CONNECTIONS {
        let Some(stranger) = guests.iter().position(|guest| !guest.standing.is_trusted()) else { return };
        guests.remove(stranger).task.abort();
    }
    let standing = Arc::new(Standing::new());
    let task = tokio::spawn(speak(stream, hall.clone(), standing.clone(), ending.clone()));
    guests.push(Guest { task, standing });
}

/// Answers one connection's requests until it is closed, its time is up, or the server ends and it has been answered.
async fn speak(stream: TcpStream, hall: Arc<Hall>, standing: Arc<Standing>, mut ending: watch::Receiver<Option<Instant>>) {
    // Answers are small or sent in large pieces: nothing is gained by waiting for more.
    let _ = stream.set_nodelay(true);
    let service = service_fn(|request| answer(request, hall.clone(), standing.clone()));
    let mut limits = http1::Builder::new();
    limits.max_buf_size(BUFFER_BYTES).max_header_size(HEAD_BYTES).max_headers(HEADERS);
    let mut connection = pin!(limits.serve_connection(Stream::new(stream, standing.clone()), service));
    let mut end = pin!(ending.wait_for(Option::is_some));
    let (mut time, mut ends) = (pin!(sleep_until(Instant::now().into())), false);
    poll_fn(|cx| {
        if !ends && end.as_mut().poll(cx).is_ready() {
            ends = true;
            connection.as_mut().graceful_shutdown();
        }
        if connection.as_mut().poll(cx).is_ready() {
            return Poll::Ready(());
        }
        let Some(until) = standing.until() else { return Poll::Pending };
        if time.deadline() != until.into() {
            time.as_mut().reset(until.into());
        }
        time.as_mut().poll(cx)
    })
    .await;
}

/// The response to a request.
async fn answer(request: Request<Incoming>, hall: Arc<Hall>, standing: Arc<Standing>) -> Result<Response<Whole>, Infallible> {
    let uri = request.uri();
    // The target of a request to a proxy has an authority, and is none of this server's.
    let target = uri.path_and_query().filter(|_| uri.authority().is_none()).map_or("", |target| target.as_str());
    let headers: Vec<(&str, &[u8])> = request.headers().iter().map(|(name, value)| (name.as_str(), value.as_bytes())).collect();
    let passed = match hall.guard.check(&Asked { method: request.method().as_str(), target, headers: &headers }) {
        Ok(()) if !request.body().is_end_stream() => Err(Refusal::Body),
        checked => checked,
    };
    let response = match passed {
        Err(refusal) => refuse(refusal, target, hall.guard.port(), &standing),
        Ok(()) => {
            standing.trust();
            let made = make(target.to_owned(), &hall).await;
            let mut response = respond(made, &standing);
            // Once more at every answer, so that a browser remembers it for as long as the page is used.
            insert(&mut response, SET_COOKIE, &hall.guard.cookie());
            response
        }
    };
    Ok(response)
}

/// Has the program make an answer.
async fn make(target: String, hall: &Hall) -> Answer {
    let (reply, made) = oneshot::channel();
    match hall.jobs.try_send(Job { target, reply }) {
        Ok(()) => {}
        Err(TrySendError::Full(_)) => return Answer::text(503, "the program is busy with other answers: try again"),
        Err(TrySendError::Disconnected(_)) => return Answer::text(503, "the program ends"),
    }
    match timeout(ANSWERING, made).await {
        Ok(Ok(answer)) => answer,
        Ok(Err(_)) => Answer::text(503, "the program ends"),
        Err(_) => Answer::text(503, "the program took too long: try again"),
    }
}

fn insert(response: &mut Response<Whole>, name: HeaderName, value: &str) {
    if let Ok(value) = HeaderValue::from_str(value) {
        response.headers_mut().insert(name, value);
    }
}

fn respond(answer: Answer, standing: &Arc<Standing>) -> Response<Whole> {
    let Answer { status, kind, body, version, policy } = answer;
    let mut response = Response::new(Whole::new(body, standing.clone()));
    *response.status_mut() = StatusCode::from_u16(status).unwrap_or(StatusCode::INTERNAL_SERVER_ERROR);
    for (name, value) in FIXED {
        insert(&mut response, HeaderName::from_static(name), value);
    }
    insert(&mut response, CONTENT_TYPE, kind);
    insert(&mut response, CONTENT_SECURITY_POLICY, &format!("{policy}; frame-ancestors 'none'"));
    if let Some(version) = version {
        insert(&mut response, ETAG, &format!("\"{version}\""));
    }
    response
}

/// The response to a request that is not answered, after which nothing more is read: a page for a person, a line for a script.
fn refuse(refusal: Refusal, target: &str, port: u16, standing: &Arc<Standing>) -> Response<Whole> {
    let words = refusal.words(port);
    let answer = match refusal {
        Refusal::Token if !target.starts_with("/data/") => Answer::notice(refusal.status(), &words),
        _ => Answer::text(refusal.status(), &words),
    };
    let mut response = respond(answer, standing);
    insert(&mut response, CONNECTION, "close");
    if refusal == Refusal::Method {
        insert(&mut response, ALLOW, "GET, HEAD");
    }
    response
}
