//! A connection that ends while its client is still sending.
//!
//! A body can be refused before all of it has arrived. Closing the socket then resets the connection, and the client loses the answer that it
//! has not read yet. So the answer is followed by the end of the stream, and what still comes is read and dropped for a while.

use std::io;
use std::pin::Pin;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::task::{Context, Poll, ready};
use std::time::Duration;
use tokio::io::{AsyncRead, AsyncWrite, ReadBuf};
use tokio::net::TcpStream;
use tokio::time::{Sleep, sleep};

/// How long what still comes is dropped.
const LINGER: Duration = Duration::from_secs(1);
/// How much of it, bytes.
const DROPPED: usize = 16 * 1024 * 1024;

/// A connection to a client.
pub(super) struct Lingering {
    stream: TcpStream,
    /// Whether the client may still be sending.
    sends: Arc<AtomicBool>,
    /// Set once the answers have ended.
    until: Option<Pin<Box<Sleep>>>,
    dropped: usize,
}

impl Lingering {
    /// `sends`: the newest request has a body that may not have been read to its end.
    pub(super) fn new(stream: TcpStream, sends: Arc<AtomicBool>) -> Self {
        Self { stream, sends, until: None, dropped: 0 }
    }
}

impl AsyncRead for Lingering {
    fn poll_read(mut self: Pin<&mut Self>, cx: &mut Context<'_>, buf: &mut ReadBuf<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_read(cx, buf)
    }
}

impl AsyncWrite for Lingering {
    fn poll_write(mut self: Pin<&mut Self>, cx: &mut Context<'_>, bytes: &[u8]) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.stream).poll_write(cx, bytes)
    }

    fn poll_flush(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        Pin::new(&mut self.stream).poll_flush(cx)
    }

    fn poll_shutdown(mut self: Pin<&mut Self>, cx: &mut Context<'_>) -> Poll<io::Result<()>> {
        if self.until.is_none() {
            ready!(Pin::new(&mut self.stream).poll_shutdown(cx))?;
            if !self.sends.load(Ordering::Relaxed) {
                return Poll::Ready(Ok(()));
            }
            self.until = Some(Box::pin(sleep(LINGER)));
        }
        let mut scratch = [0; 16 * 1024];
        while self.dropped < DROPPED {
            let mut buf = ReadBuf::new(&mut scratch);
            match Pin::new(&mut self.stream).poll_read(cx, &mut buf) {
                Poll::Ready(Ok(())) if !buf.filled().is_empty() => {
                    self.dropped += buf.filled().len();
                }
                // The client has closed its side, or broken off.
                Poll::Ready(_) => return Poll::Ready(Ok(())),
                Poll::Pending => return self.until.as_mut().map_or(Poll::Ready(()), |until| until.as_mut().poll(cx)).map(Ok),
            }
        }
        Poll::Ready(Ok(()))
    }

    fn poll_write_vectored(mut self: Pin<&mut Self>, cx: &mut Context<'_>, parts: &[io::IoSlice<'_>]) -> Poll<io::Result<usize>> {
        Pin::new(&mut self.stream).poll_write_vectored(cx, parts)
    }

    fn is_write_vectored(&self) -> bool {
        self.stream.is_write_vectored()
    }
}
