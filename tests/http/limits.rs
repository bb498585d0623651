//! Sizes, deadlines, connection slots and shutdown.

use crate::rig::{PLAN, Rig, settings};
use crate::wire::{Answer, PATIENCE, connect, exchange, read_answer, read_until};
use carved::config::HttpSettings;
use std::io::{ErrorKind, Read, Write};
use std::net::TcpStream;
use std::sync::Arc;
use std::time::{Duration, Instant};

const JSON: (&str, &str) = ("Content-Type", "application/json");

#[test]
fn bodies_are_bounded_on_every_route() {
    let rig = Rig::start();
    let well = r#"{"loaded": true}"#;
    let padded = |body: &str, length: usize| format!("{body}{}", " ".repeat(length - body.len()));
    // The limit is exact to the byte: white space after the value is part of the body.
    assert_eq!(rig.put("/v1/runs/r", &padded(PLAN, 1 << 20)).status, 201);
    assert_eq!(rig.put("/v1/runs/r/wells/A01", &padded(well, 64 << 10)).status, 200);
    for (method, path, body) in [
        ("PUT", "/v1/runs/r", padded(PLAN, (1 << 20) + 1)),
        ("PUT", "/v1/runs/r/wells/A01", padded(well, (64 << 10) + 1)),
        ("POST", "/v1/runs/r/abort", padded("", (64 << 10) + 1)),
    ] {
        let answer = rig.send(method, path, &[JSON], &body);
        assert_eq!((answer.status, answer.problem().as_str()), (413, "too_large"), "{method} {path}");
    }
    // A body without a length is counted while it arrives.
    let mut request = b"PUT /v1/runs/r/wells/A01 HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n".to_vec();
    request.extend(b"Transfer-Encoding: chunked\r\n\r\n");
    for _chunk in 0..5 {
        request.extend(format!("4000\r\n{}\r\n", " ".repeat(0x4000)).bytes());
    }
    assert_eq!(exchange(rig.address, &request).problem(), "too_large");
}

/// More than the buffers of both sides hold, so the client is still sending when it is refused.
#[test]
fn a_client_that_is_refused_while_it_sends_reads_the_answer() {
    let rig = Rig::start();
    let body = vec![b' '; 12 << 20];
    for path in ["/v1/preflight", "/v1/runs/r/abort", "/v1/nowhere"] {
        let head =
            format!("POST {path} HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nContent-Length: {}\r\n\r\n", body.len());
        let mut stream = connect(rig.address);
        stream.write_all(head.as_bytes()).unwrap();
        // The refusal is there before the body is sent.
        assert!(stream.peek(&mut [0]).unwrap() > 0);
        stream.write_all(&body).unwrap();
        let expected = if path == "/v1/nowhere" { 404 } else { 413 };
        assert_eq!(read_answer(&mut stream).status, expected, "{path}");
    }
}

#[test]
fn heads_are_bounded() {
    let rig = Rig::start();
    let fits = format!("GET /v1/status HTTP/1.1\r\nHost: localhost\r\nX-Padding: {}\r\n\r\n", "x".repeat(8 << 10));
    assert_eq!(exchange(rig.address, fits.as_bytes()).status, 200);
    let long = format!("GET /v1/status HTTP/1.1\r\nHost: localhost\r\nX-Padding: {}\r\n\r\n", "x".repeat(17 << 10));
    assert_eq!(exchange(rig.address, long.as_bytes()).status, 431);
    let many: String = (0..200).map(|i| format!("X-{i}: 1\r\n")).collect();
    let many = format!("GET /v1/status HTTP/1.1\r\nHost: localhost\r\n{many}\r\n");
    assert_eq!(exchange(rig.address, many.as_bytes()).status, 431);
    assert_eq!(exchange(rig.address, b"NONSENSE\r\n\r\n").status, 400);
}

/// Sends one byte of a head at a time until the server closes the connection.
fn dribble(mut stream: TcpStream) {
    stream.set_read_timeout(Some(Duration::from_millis(10))).unwrap();
    let deadline = Instant::now() + PATIENCE;
    let mut byte = [0];
    while Instant::now() < deadline {
        match stream.read(&mut byte) {
            Err(why) if matches!(why.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut) => {}
            Ok(0) | Err(_) => return,
            Ok(_) => continue,
        }
        if stream.write_all(b"x").is_err() {
            return;
        }
    }
    panic!("the connection still lives");
}

#[test]
fn clients_that_dribble_their_heads_are_cut_and_the_others_served() {
    let rig = Rig::with(HttpSettings { head_timeout_ms: 100, ..settings() }, Vec::new());
    let dribblers: Vec<_> = (0..40)
        .map(|_| {
            let mut stream = connect(rig.address);
            stream.write_all(b"GET /v1/status HTTP/1.1\r\nHost: localhost\r\nX-Slow: ").unwrap();
            std::thread::spawn(move || dribble(stream))
        })
        .collect();
    assert_eq!(rig.get("/v1/status").status, 200);
    for dribbler in dribblers {
        dribbler.join().unwrap();
    }
    // The same holds for a connection that sends nothing.
    dribble_nothing(connect(rig.address));
    assert_eq!(rig.get("/v1/status").status, 200);
}

fn dribble_nothing(mut stream: TcpStream) {
    let ended = stream.read(&mut [0; 256]);
    assert!(!matches!(&ended, Err(why) if why.kind() == ErrorKind::WouldBlock), "{ended:?}");
}

/// The only slot is taken by a client that asks for more than the buffers hold and reads nothing.
#[test]
fn a_client_that_reads_nothing_loses_its_slot() {
    let rig = Rig::with(HttpSettings { head_timeout_ms: 300, max_connections: 1, ..settings() }, Vec::new());
    rig.driver.set_live(|live| live.frame_jpg = Some(Arc::new(vec![0; 64 << 20])));
    let mut greedy = connect(rig.address);
    greedy.write_all(b"GET /v1/live/frame.jpg HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
    assert_eq!(rig.get("/v1/status").status, 200);
}

/// Of four connections two may wait.
#[test]
fn clients_that_wait_leave_slots_for_the_emergency_stop() {
    let rig = Rig::with(HttpSettings { max_connections: 4, ..settings() }, Vec::new());
    let asking = |path: &str| {
        let mut stream = connect(rig.address);
        stream.write_all(format!("GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n").as_bytes()).unwrap();
        stream
    };
    let refusal = |answer: Answer| {
        assert_eq!(answer.header("retry-after"), Some("5"), "{answer:?}");
        (answer.status, answer.problem())
    };
    let mut polls: Vec<_> = (0..3).map(|_| asking("/v1/status?wait=30&after=41")).collect();
    let mut over = polls.swap_remove(first_answered(&polls));
    assert_eq!(refusal(read_answer(&mut over)), (503, "busy".into()));
    assert_eq!(refusal(rig.get("/v1/events")), (503, "busy".into()));
    assert_eq!(rig.get("/v1/status").status, 200);
    assert_eq!(rig.get("/v1/status?wait=30&after=40").status, 200, "news that are there already need no slot");
    assert_eq!(rig.send("POST", "/v1/emergency-stop", &[], "").status, 200);
    drop(over);
    rig.driver.publish(|s| s.doing = "something else".into());
    for mut poll in polls {
        assert_eq!(read_answer(&mut poll).status, 200);
    }
    let mut streams: Vec<_> = (0..2).map(|_| asking("/v1/events")).collect();
    for stream in &mut streams {
        read_until(stream, b"retry: 2000");
    }
    assert_eq!(refusal(rig.get("/v1/events")), (503, "busy".into()));
    assert_eq!(rig.send("POST", "/v1/emergency-stop", &[], "").status, 200);
}

/// The first of these connections that has an answer.
fn first_answered(streams: &[TcpStream]) -> usize {
    let deadline = Instant::now() + PATIENCE;
    loop {
        for (i, stream) in streams.iter().enumerate() {
            stream.set_read_timeout(Some(Duration::from_millis(10))).unwrap();
            let is_answered = stream.peek(&mut [0]).is_ok_and(|bytes| bytes > 0);
            stream.set_read_timeout(Some(PATIENCE)).unwrap();
            if is_answered {
                return i;
            }
        }
        assert!(Instant::now() < deadline, "none of them is answered");
    }
}

/// The deadline for the next request of a connection is ten minutes here.
#[test]
fn idle_connections_give_their_slots_to_clients_that_wait() {
    let rig = Rig::with(HttpSettings { max_connections: 2, head_timeout_ms: 600_000, ..settings() }, Vec::new());
    let _idle: Vec<_> = (0..2)
        .map(|_| {
            let mut stream = connect(rig.address);
            for _kept_alive in 0..2 {
                stream.write_all(b"GET /v1/status HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
                assert_eq!(read_answer(&mut stream).status, 200);
            }
            stream
        })
        .collect();
    assert_eq!(rig.send("POST", "/v1/emergency-stop", &[], "").status, 200);
}

#[test]
fn a_client_over_the_number_of_slots_waits_for_one() {
    let rig = Rig::with(HttpSettings { max_connections: 1, ..settings() }, Vec::new());
    let mut first = connect(rig.address);
    first.write_all(b"GET /v1/events HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
    read_until(&mut first, b"retry: 2000");
    let mut second = connect(rig.address);
    second.write_all(b"GET /v1/status HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
    second.set_read_timeout(Some(Duration::from_millis(50))).unwrap();
    assert!(second.read(&mut [0]).is_err(), "served although the only slot is taken");
    drop(first);
    second.set_read_timeout(Some(PATIENCE)).unwrap();
    assert_eq!(read_answer(&mut second).status, 200);
}

/// Reads everything until the server closes. Keep-alive comments must not hide a late end, so the total time is limited.
fn rest_of(mut stream: TcpStream) -> Vec<u8> {
    let deadline = Instant::now() + PATIENCE;
    let (mut rest, mut piece) = (Vec::new(), [0; 4096]);
    loop {
        let read = stream.read(&mut piece).unwrap();
        if read == 0 {
            return rest;
        }
        rest.extend_from_slice(&piece[..read]);
        assert!(Instant::now() < deadline, "the stream still lives");
    }
}

#[test]
fn the_end_ends_streams_and_long_polls_and_joins_all() {
    // With this drain deadline the server ends in time only if every connection ends by itself.
    let mut rig = Rig::with(HttpSettings { drain_ms: 600_000, ..settings() }, Vec::new());
    let mut stream = connect(rig.address);
    stream.write_all(b"GET /v1/events HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
    read_until(&mut stream, b"retry: 2000");
    let mut poll = connect(rig.address);
    poll.write_all(b"GET /v1/status?wait=30&after=41 HTTP/1.1\r\nHost: localhost\r\n\r\n").unwrap();
    let idle = connect(rig.address);
    rig.stop();
    let rest = rest_of(stream);
    assert!(rest.ends_with(b"0\r\n\r\n"), "the stream has a proper end: {:?}", String::from_utf8_lossy(&rest));
    let address = rig.address;
    rig.finish().unwrap();
    assert!(TcpStream::connect(address).is_err(), "the port is closed");
    drop(idle);
}

#[test]
fn a_request_that_does_not_end_is_cut_at_the_deadline() {
    let rig = Rig::with(HttpSettings { drain_ms: 50, body_timeout_ms: 600_000, ..settings() }, Vec::new());
    let mut stream = connect(rig.address);
    let head = "PUT /v1/runs/r HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\nExpect: 100-continue\r\nContent-Length: 100\r\n\r\n";
    stream.write_all(head.as_bytes()).unwrap();
    // The server asks for the body: the request is under way and will never be completed.
    read_until(&mut stream, b"100 Continue\r\n\r\n");
    rig.finish().unwrap();
}
