//! An HTTP receiver of notices that answers by a script.
#![allow(dead_code)] // each test binary uses its own part

use super::wait::{PATIENCE, until};
use serde_json::Value;
use std::collections::{BTreeMap, VecDeque};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::{TcpListener, TcpStream};
use std::sync::{Arc, Mutex};

/// What the receiver does with a request.
#[derive(Clone, Copy, Debug)]
pub enum Reply {
    /// An answer with this status.
    Status(u16),
    /// No answer, while the connection stays open.
    Never,
}

/// A request that was received.
#[derive(Clone, Debug)]
pub struct Received {
    pub path: String,
    /// Names in lower case.
    pub headers: BTreeMap<String, String>,
    pub body: String,
}

impl Received {
    pub fn json(&self) -> Value {
        serde_json::from_str(&self.body).unwrap()
    }
}

/// A receiver. Requests beyond the script get the last reply of it.
pub struct Receiver {
    pub url: String,
    received: Arc<Mutex<Vec<Received>>>,
}

impl Receiver {
    pub fn start(script: &[Reply]) -> Self {
        Self::with(script, |stream| Box::new(stream))
    }

    /// `wrap` may add TLS to a connection.
    pub fn with(script: &[Reply], wrap: impl Fn(TcpStream) -> Box<dyn Connection> + Send + 'static) -> Self {
        let listener = TcpListener::bind("127.0.0.1:0").unwrap();
        let url = format!("http://{}", listener.local_addr().unwrap());
        let received = Arc::new(Mutex::new(Vec::new()));
        let (seen, mut script) = (received.clone(), VecDeque::from(script.to_vec()));
        std::thread::spawn(move || {
            // Connections without an answer stay open.
            let mut open = Vec::new();
            for stream in listener.incoming() {
                let mut stream = wrap(stream.unwrap());
                // A connection without a request only looks whether somebody is here.
                let Some(request) = read(&mut stream) else { continue };
                seen.lock().unwrap().push(request);
                let reply = if script.len() > 1 { script.pop_front() } else { script.front().copied() };
                match reply {
                    Some(Reply::Status(status)) => {
                        let answer = format!("HTTP/1.1 {status} Scripted\r\nContent-Length: 0\r\nConnection: close\r\n\r\n");
                        // The client may have given up.
                        drop(stream.write_all(answer.as_bytes()).and_then(|()| stream.flush()));
                    }
                    Some(Reply::Never) | None => open.push(stream),
                }
            }
        });
        Self { url, received }
    }

    pub fn received(&self) -> Vec<Received> {
        self.received.lock().unwrap().clone()
    }

    /// Waits for this many requests.
    pub fn wait(&self, count: usize) -> Vec<Received> {
        until(&format!("{count} requests"), || self.received().len() >= count);
        self.received()
    }
}

pub trait Connection: Read + Write + Send {}
impl<T: Read + Write + Send> Connection for T {}

fn read(stream: &mut Box<dyn Connection>) -> Option<Received> {
    let mut reader = BufReader::new(stream);
    let mut line = String::new();
    reader.read_line(&mut line).ok().filter(|read| *read > 0)?;
    let path = line.split(' ').nth(1)?.to_owned();
    let mut headers = BTreeMap::new();
    loop {
        let mut line = String::new();
        reader.read_line(&mut line).ok()?;
        let Some((name, value)) = line.trim_end().split_once(": ") else { break };
        headers.insert(name.to_lowercase(), value.to_owned());
    }
    let mut body = vec![0; headers.get("content-length")?.parse().ok()?];
    reader.read_exact(&mut body).ok()?;
    Some(Received { path, headers, body: String::from_utf8(body).ok()? })
}
