//! One connection of a browser: what of it is bounded in time, and bodies that all connections share.

use hyper::body::{Body, Bytes, Frame, SizeHint};
use hyper::rt::{Read, ReadBufCursor, Write};
use std::convert::Infallible;
use std::io;
use std::pin::Pin;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, ready};
use std::time::{Duration, Instant};
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpStream;

/// Longest time in which a client sends a request, from the moment on that it is connected or was answered: nobody dribbles, and nobody idles.
pub(super) const ASKING: Duration = Duration::from_secs(10);
/// Longest time in which a client that is being answered takes not a byte.
pub(super) const STALLED: Duration = Duration::from_secs(10);
/// Rate that a client must take an answer at on the whole, bytes a second, beside [`STALLED`] to begin with.
pub(super) const LEAST_RATE: u64 = 256 << 10;
/// Longest time in which the program makes an answer.
pub(super) const ANSWERING: Duration = Duration::from_secs(120);
/// Longest time for which a connection that is closed is read on, so that its last answer comes to a client that is still sending.
const LINGERING: Duration = Duration::from_millis(500);
/// Most bytes that are read from it then.
const LINGERING_BYTES: usize = 256 << 10;

/// Bytes that a connection is given at once.
const PIECE: usize = 64 << 10;
/// Bytes that are read at once.
const READ: usize = 4 << 10;

/// Where a connection stands, and until when it may stay there.
pub(super) struct Standing(Mutex<Inner>);

struct Inner {
    /// Whether it has shown the token.
    trusted: bool,
    /// When it is over unless it goes on: none while the program has the word.
    until: Option<Instant>,
    /// While an answer is sent: when that is over, however steadily the client takes it.
    at_last: Option<Instant>,
}

impl Standing {
    pub(super) fn new() -> Self {
        Self(Mutex::new(Inner { trusted: false, until: Some(Instant::now() + ASKING), at_last: None }))
    }

    fn inner(&self) -> MutexGuard<'_, Inner> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// When its time is up.
    pub(super) fn until(&self) -> Option<Instant> {
        let inner = self.inner();
        match (inner.until, inner.at_last) {
            (Some(a), Some(b)) => Some(a.min(b)),
            (a, b) => a.or(b),
        }
    }

    pub(super) fn is_trusted(&self) -> bool {
        self.inner().trusted
    }

    /// It has shown the token, and the program makes its answer.
    pub(super) fn trust(&self) {
        let mut inner = self.inner();
        (inner.trusted, inner.until) = (true, None);
    }

    /// An answer of `bytes` begins.
    pub(super) fn sends(&self, bytes: usize) {
        let (mut inner, now) = (self.inner(), Instant::now());
        inner.until = Some(now + STALLED);
        inner.at_last = Some(now + STALLED + Duration::from_secs(bytes as u64 / LEAST_RATE));
    }

    /// The client has taken some of it.
    fn took(&self) {
        let mut inner = self.inner();
        if inner.at_last.is_some() {
            inner.until = Some(Instant::now() + STALLED);
        }
    }

    /// It has been given all of it.
    fn sent(&self) {
        let mut inner = self.inner();
        (inner.until, inner.at_last) = (Some(Instant::now() + ASKING), None);
    }

    /// It is being closed.
    fn lingers(&self) {
        let mut inner = self.inner();
        (inner.until, inner.at_last) = (Some(Instant::now() + LINGERING), None);
    }
}

/// Content of an answer that is shared by all who are sent it, and given in pieces: a slow client holds none of its own.
pub(super) struct Whole {
    rest: Bytes,
    standing: Arc<Standing>,
}

/// Bytes with an owner, as `Bytes` takes them.
struct Owned(Arc<Vec<u8>>);

impl AsRef<[u8]> for Owned {
    fn as_ref(&self) -> &[u8] {
        &self.0
    }
}

impl Whole {
    pub(super) fn new(content: Arc<Vec<u8>>, standing: Arc<Standing>) -> Self {
        standing.sends(content.len());
        Self { rest: Bytes::from_owner(Owned(content)), standing }
    }
}

impl Body for Whole {
    type Data = Bytes;
    type Error = Infallible;

    fn poll_frame(mut self: Pin<&mut Self>, _: &mut Context<'_>) -> Poll<Option<Result<Frame<Bytes>, Infallible>>> {
        let length = self.rest.len().min(PIECE);
        Poll::Ready((length > 0).then(|| Ok(Frame::data(self.rest.split_to(length)))))
    }

    fn is_end_stream(&self) -> bool {
        self.rest.is_empty()
    }

    fn size_hint(&self) -> SizeHint {
        SizeHint::with_exact(self.rest.len() as u64)
    }
}

impl Drop for Whole {
    fn drop(&mut self) {
        self.standing.sent();
    }
}

/// The stream of a connection.
pub(super) struct Stream {
    stream: TcpStream,
    standing: Arc<Standing>,
    /// Bytes that were read since it was closed; none before.
    lingering: Option<usize>,
}

impl Stream {
    pub(super) fn new(stream: TcpStream, standing: Arc<Standing>) -> Self {
        Self { stream, standing, lingering: None }
    }

    /// Reads up to [`READ`] bytes; how many they are, 0 at the end.
    fn read(&mut self, cx: &mut Context<'_>, buffer: &mut [u8]) -> Poll<io::Result<usize>> {
        let mut buffer = ReadBuf::new(buffer);
        ready!(Pin::new(&mut self.stream).poll_read(cx, &mut buffer))?;
        Poll::Ready(Ok(buffer.filled().len()))
    }
}

impl Read for Stream {
    fn poll_read(mut self: Pin<&mut Self>, cx: &mut Context<'_>, mut to: ReadBufCursor<'_>) -> Poll<io::Result<()>> {
        let mut buffer = [0; READ];
        let most = to.remaining().min(READ);
        let count = ready!(self.read(cx, &mut buffer[..most]))?;
        to.put_slice(&buffer[..count]);
        Poll::Ready(Ok(()))
    }
}

impl Write for Stream {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        let count = ready!(Pin::new(&mut self.stream).poll_write(cx, bytes))?;
        if count > 0 {
            self.standing.took();
        }
        Poll::Ready(Ok(count))
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(cx)
    }

    /// Says that nothing follows, and reads on until the client has understood: a connection that is closed with something unread is reset, and
    /// the last answer may be lost with it.
    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        if self.lingering.is_none() {
            ready!(Pin::new(&mut self.stream).poll_shutdown(cx))?;
            self.standing.lingers();
            self.lingering = Some(0);
        }
        let mut buffer = [0; READ];
        loop {
            let count = ready!(self.read(cx, &mut buffer))?;
            let all = self.lingering.unwrap_or(0) + count;
            self.lingering = Some(all);
            if count == 0 || all > LINGERING_BYTES {
                return Poll::Ready(Ok(()));
            }
        }
    }
}
