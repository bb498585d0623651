//! Notifications to systemd: readiness, status, the watchdog's ping and the end.
//!
//! ```text
//! serve: ready ─> status ... status ─> stopping
//! driver alive? ── every half WatchdogSec ── yes: ping
//!                                            no: no ping, and systemd kills and restarts the daemon
//! ending, and a thread writes to the disk? ── every 2 s ── yes: more time, for ten minutes at most
//!                                                          no: systemd kills the daemon after TimeoutStopSec
//! ```
//! Without systemd (no `NOTIFY_SOCKET`) these functions do nothing.

use sd_notify::NotifyState;
use std::io;
use std::time::Duration;
use tokio::time::{MissedTickBehavior, interval};

/// Pause between two requests for more time to end, the time that each asks for, and their number: ten minutes. An end in mid-turn takes
/// about twenty syncs one after another.
const ASK_AGAIN: Duration = Duration::from_secs(2);
const MORE_US: u32 = 10_000_000;
const MOST_ASKED: u32 = 300;
/// How long after its last operation a thread still counts as one that writes: between two of them it computes.
const BETWEEN: Duration = Duration::from_secs(5);
/// Time of one operation from which the disk keeps the daemon from ending, and time from which it hangs and is waited for no longer.
const SLOW: Duration = Duration::from_secs(2);
const HANGS: Duration = Duration::from_secs(120);

/// A lost notification is no reason to stop an instrument. The watchdog judges by the notifications that arrive.
fn send(states: &[NotifyState]) {
    if let Err(why) = sd_notify::notify(states) {
        tracing::warn!(%why, "systemd could not be notified");
    }
}

/// Makes one line for `systemctl status`, because a line break would begin a new notification.
fn one_line(doing: &str) -> String {
    doing.replace(['\r', '\n'], " ")
}

/// The port is open and the driver runs.
pub fn ready(doing: &str) {
    send(&[NotifyState::Ready, NotifyState::Status(&one_line(doing))]);
}

/// What the instrument is doing, in one sentence.
pub fn status(doing: &str) {
    send(&[NotifyState::Status(&one_line(doing))]);
}

/// The daemon ends in an orderly way.
pub fn stopping() {
    send(&[NotifyState::Stopping]);
}

/// Asks for more time to end while the disk is busy, and says so: a slow disk is no reason to kill the daemon before it has written that it
/// was asked to end, because the next start would take the end for a crash.
pub async fn extend_end() {
    extend_while(
        ASK_AGAIN,
        MOST_ASKED,
        || carved_store::busy_for(BETWEEN),
        |why| {
            send(&[NotifyState::ExtendTimeoutUsec(MORE_US), NotifyState::Status(why)]);
        },
    )
    .await;
    tracing::error!("the disk has kept the daemon from ending for ten minutes; no more time is asked for");
}

async fn extend_while(again: Duration, most: u32, busy_for: impl Fn() -> Option<Duration>, extend: impl Fn(&str)) {
    let mut beat = interval(again);
    beat.set_missed_tick_behavior(MissedTickBehavior::Delay);
    for _ in 0..most {
        beat.tick().await;
        match busy_for() {
            None => {}
            Some(takes) if takes >= HANGS => {
                tracing::error!(takes_s = takes.as_secs(), "one write to the data folder does not end; no more time is asked for");
            }
            Some(takes) if takes >= SLOW => {
                let takes_s = takes.as_secs();
                tracing::warn!(takes_s, "the motors were stopped; ending waits for a write to the data folder");
                extend(&format!("Ending. The motors were stopped. A write to the data folder has taken {takes_s} s so far."));
            }
            Some(_) => extend("Ending. The motors were stopped."),
        }
    }
}

/// Pings systemd's watchdog while `alive` returns true. Runs until it is dropped. Without a watchdog it only waits.
///
/// `alive` must report the progress of the driver (a heartbeat that it renews), not that of this task.
pub async fn watchdog(alive: impl Fn() -> bool) {
    match sd_notify::watchdog_enabled() {
        Some(within) => ping_while(within, alive, || sd_notify::notify(&[NotifyState::Watchdog])).await,
        None => std::future::pending().await,
    }
}

/// Pings at half the interval: a ping may be late by this time and still arrive in time.
async fn ping_while(within: Duration, alive: impl Fn() -> bool, ping: impl Fn() -> io::Result<()>) {
    // A zero interval would panic. systemd does not request one.
    let mut beat = interval((within / 2).max(Duration::from_millis(1)));
    beat.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        beat.tick().await;
        if !alive() {
            tracing::error!("the driver shows no sign of life; the watchdog is not pinged");
        } else if let Err(why) = ping() {
            tracing::warn!(%why, "the watchdog could not be pinged");
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Mutex;
    use std::sync::atomic::{AtomicBool, AtomicU32, Ordering::SeqCst};
    use tokio::sync::mpsc;

    #[tokio::test]
    async fn pings_only_while_the_driver_lives() {
        let (asked, mut questions) = mpsc::unbounded_channel();
        let (alive, pings) = (AtomicBool::new(true), AtomicU32::new(0));
        let asks = || {
            asked.send(()).unwrap();
            alive.load(SeqCst)
        };
        let count = || {
            pings.fetch_add(1, SeqCst);
            Ok(())
        };
        let script = async {
            // When the driver is asked for the fourth time, three pings have been sent.
            for _beat in 0..4 {
                questions.recv().await.unwrap();
            }
            assert!(pings.load(SeqCst) >= 3, "{}", pings.load(SeqCst));
            alive.store(false, SeqCst);
            questions.recv().await.unwrap();
            let dead = pings.load(SeqCst);
            for _beat in 0..3 {
                questions.recv().await.unwrap();
            }
            assert_eq!(pings.load(SeqCst), dead, "a dead driver was pinged for");
            alive.store(true, SeqCst);
            for _beat in 0..3 {
                questions.recv().await.unwrap();
            }
            assert!(pings.load(SeqCst) > dead, "a driver that came back is pinged for");
        };
        tokio::select! {
            () = ping_while(Duration::from_millis(4), asks, count) => unreachable!("runs until it is dropped"),
            () = script => {}
        }
    }

    #[tokio::test]
    async fn an_end_gets_more_time_while_the_disk_is_busy_and_not_for_ever() {
        let (asked, given) = (AtomicU32::new(0), Mutex::new(Vec::new()));
        let busy_for = || match asked.fetch_add(1, SeqCst) {
            0..5 => Some(Duration::ZERO),
            5..8 => None,
            8..10 => Some(HANGS),
            _ => Some(Duration::from_secs(15)),
        };
        extend_while(Duration::from_millis(1), 20, busy_for, |why| given.lock().unwrap().push(why.to_owned())).await;
        let given = given.into_inner().unwrap();
        assert_eq!((asked.load(SeqCst), given.len()), (20, 15));
        assert!(!given[4].contains("15 s") && given[5..].iter().all(|why| why.contains("has taken 15 s")), "{given:?}");
    }

    #[test]
    fn a_sentence_stays_one_line() {
        assert_eq!(one_line("well A01\nREADY=1\r"), "well A01 READY=1 ");
    }
}
