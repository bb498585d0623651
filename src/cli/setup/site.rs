//! The set-up as a page: a small server on the same conversation that a terminal leads.
//!
//! ```text
//! browser ── GET /v1/setup?after=N ──► view of revision > N         (watch) ◄── Page: Person
//!         ── POST /v1/setup/answer ──► answer to question number K ──(mpsc)──►   │ the thread of the conversation
//!         ── POST /v1/setup/stop ────► Stopper, at once, then the end            ▼
//!         ── POST /v1/setup/end ─────► the end, once the file is written      Machine, Bench
//! ```
//! An answer names the number of its question, so that a second click is not taken for the answer to the next one.

use super::bench::{Action, Bench};
use super::dialogue::{Person, Stopped};
use super::machine::{Machine, Refused, STAGES, Step};
use super::question::{Kind, Question, title};
use super::rig::{Shown, Stopper};
use super::{Args, Work};
use crate::config::HttpSettings;
use crate::http::{self, Problem};
use anyhow::Context;
use axum::extract::{DefaultBodyLimit, Query, State as Shared, rejection::JsonRejection};
use axum::http::{StatusCode, header};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};
use axum::{Json, Router};
use serde::{Deserialize, Serialize};
use std::net::SocketAddr;
use std::sync::{Arc, mpsc};
use std::time::Duration;
use tokio::sync::{oneshot, watch};

/// Lines of the log that a page gets.
const LOG_LINES: usize = 200;
/// Longest time for which a poll waits.
const POLL: Duration = Duration::from_secs(25);
/// Size limit of a body, bytes.
const BODY_BYTES: usize = 16 * 1024;

/// What the page shows.
#[derive(Clone, Default, Serialize)]
struct View {
    /// Rises with every change.
    revision: u64,
    /// The configuration that will be written.
    file: String,
    /// What the person has to know of an emulated rig.
    simulated: Option<String>,
    stages: [&'static str; STAGES.len()],
    /// Index of the current stage; the number of stages at the end.
    stage: usize,
    /// `None` while the instrument works and at the end.
    question: Option<AskedQuestion>,
    /// What the instrument does.
    doing: Option<&'static str>,
    /// Pictures of this work that were taken, and all of them.
    taken: Option<[usize; 2]>,
    answers: Vec<Given>,
    log: Vec<String>,
    /// Number of the newest picture; 0 before the first one.
    picture: u64,
    ended: Option<Ended>,
    #[serde(skip)]
    jpeg: Option<Arc<Vec<u8>>>,
}

#[derive(Clone, Serialize)]
struct AskedQuestion {
    /// It goes back with the answer.
    number: u64,
    id: &'static str,
    title: String,
    text: String,
    kind: Kind,
    default: Option<String>,
    /// Why it is asked again.
    problem: Option<String>,
}

#[derive(Clone, Serialize)]
struct Given {
    title: String,
    answer: String,
}

#[derive(Clone, Serialize)]
struct Ended {
    /// The configuration was written.
    is_done: bool,
    text: String,
}

/// A message from the page.
enum Message {
    Answer { number: u64, typed: String, back: oneshot::Sender<Result<(), NotTaken>> },
    End,
}

/// Why an answer was not taken.
enum NotTaken {
    Refused(String),
    /// Another question is asked now.
    Late,
}

/// The person at the page.
struct Page {
    view: Arc<watch::Sender<View>>,
    messages: mpsc::Receiver<Message>,
    /// Who waits for the verdict on the newest answer.
    pending: Option<oneshot::Sender<Result<(), NotTaken>>>,
    /// Why the newest answer was refused. Its sender learns it once the question is asked again, and can then answer it.
    refusal: Option<String>,
    asked: u64,
    exists: bool,
}

impl Page {
    fn change(&self, change: impl FnOnce(&mut View)) {
        self.view.send_modify(|view| {
            change(view);
            view.revision += 1;
        });
    }

    fn place(view: &mut View, machine: &Machine, step: &Step) {
        view.stage = machine.stage(step);
        view.answers = machine.given().map(|(id, answer)| Given { title: title(id).to_owned(), answer: answer.to_owned() }).collect();
        view.taken = None;
    }

    fn say(view: &mut View, text: &str) {
        view.log.push(text.to_owned());
        let excess = view.log.len().saturating_sub(LOG_LINES);
        view.log.drain(..excess);
    }
}

impl Person for Page {
    fn tell(&mut self, text: &str) -> anyhow::Result<()> {
        self.change(|view| Self::say(view, text));
        Ok(())
    }

    fn busy(&mut self, action: Action, machine: &Machine) -> anyhow::Result<()> {
        self.change(|view| {
            Self::place(view, machine, &Step::Act(action));
            (view.question, view.doing) = (None, Some(action.doing()));
        });
        Ok(())
    }

    fn ask(&mut self, question: &Question, machine: &Machine) -> anyhow::Result<String> {
        self.asked += 1;
        let asked = AskedQuestion {
            number: self.asked,
            id: question.id,
            title: title(question.id).to_owned(),
            text: question.text.clone(),
            kind: question.kind.clone(),
            default: question.default.clone(),
            problem: question.problem.clone(),
        };
        self.change(|view| {
            Self::place(view, machine, &machine.next(self.exists));
            view.doing = None;
            view.question = Some(asked);
        });
        if let (Some(back), Some(why)) = (self.pending.take(), self.refusal.take()) {
            let _gone = back.send(Err(NotTaken::Refused(why)));
        }
        loop {
            match self.messages.recv().context("the server of the page has ended")? {
                Message::Answer { number, typed, back } if number == self.asked => {
                    self.pending = Some(back);
                    return Ok(typed);
                }
                // Who sent it may be gone.
                Message::Answer { back, .. } => drop(back.send(Err(NotTaken::Late))),
                Message::End => return Err(Stopped.into()),
            }
        }
    }

    fn answered(&mut self, _: &Question, refused: Option<&Refused>) -> anyhow::Result<()> {
        self.refusal = refused.map(Refused::text);
        if self.refusal.is_none()
            && let Some(back) = self.pending.take()
        {
            let _gone = back.send(Ok(()));
        }
        Ok(())
    }
}

/// What the routes share.
#[derive(Clone)]
struct Site {
    view: Arc<watch::Sender<View>>,
    messages: mpsc::Sender<Message>,
    stopper: Stopper,
    closing: watch::Receiver<bool>,
}

#[derive(Deserialize)]
struct Poll {
    /// Wait for a revision after this one.
    after: Option<u64>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct AnswerBody {
    number: u64,
    answer: String,
}

fn routes(site: Site) -> Router {
    Router::new()
        .route("/v1/setup", get(look))
        .route("/v1/setup/picture.jpg", get(picture))
        .route("/v1/setup/answer", post(answer))
        .route("/v1/setup/stop", post(stop))
        .route("/v1/setup/end", post(end))
        .fallback(http::setup_page)
        .layer(DefaultBodyLimit::max(BODY_BYTES))
        .with_state(site)
}

async fn look(Shared(site): Shared<Site>, Query(poll): Query<Poll>) -> Json<View> {
    let mut seen = site.view.subscribe();
    let mut closing = site.closing.clone();
    let newer = seen.wait_for(|view| poll.after.is_none_or(|after| view.revision > after));
    tokio::select! {
        _changed = tokio::time::timeout(POLL, newer) => {}
        _ended = closing.wait_for(|closing| *closing) => {}
    }
    Json(site.view.borrow().clone())
}

async fn picture(Shared(site): Shared<Site>) -> Response {
    let jpeg = site.view.borrow().jpeg.clone();
    match jpeg {
        Some(jpeg) => ([(header::CONTENT_TYPE, "image/jpeg")], jpeg.to_vec()).into_response(),
        None => Problem::new(StatusCode::NOT_FOUND, "no_picture", "no picture was taken yet").into_response(),
    }
}

async fn answer(Shared(site): Shared<Site>, body: Result<Json<AnswerBody>, JsonRejection>) -> Result<StatusCode, Problem> {
    let Json(body) = body.map_err(|why| Problem::new(why.status(), "not_an_answer", why.body_text()))?;
    let (back, verdict) = oneshot::channel();
    let message = Message::Answer { number: body.number, typed: body.answer, back };
    let late = || Problem::new(StatusCode::CONFLICT, "another_question", "this question is not asked any more; look at the page again");
    // While the instrument works, the message waits, and is late then.
    if site.view.borrow().question.as_ref().is_none_or(|question| question.number != body.number) {
        return Err(late());
    }
    site.messages.send(message).map_err(|_| late())?;
    match verdict.await {
        Ok(Ok(())) => Ok(StatusCode::NO_CONTENT),
        Ok(Err(NotTaken::Refused(why))) => Err(Problem::new(StatusCode::UNPROCESSABLE_ENTITY, "refused", why)),
        Ok(Err(NotTaken::Late)) | Err(_) => Err(late()),
    }
}

async fn stop(Shared(site): Shared<Site>) -> Json<View> {
    let stopper = site.stopper.clone();
    // The stop writes to a port. A panic there is that of the port's owner.
    let _stopped = tokio::task::spawn_blocking(move || stopper.stop()).await;
    end(Shared(site)).await
}

/// Ends a set-up that waits, and answers once it has ended.
async fn end(Shared(site): Shared<Site>) -> Json<View> {
    let _gone = site.messages.send(Message::End);
    let mut seen = site.view.subscribe();
    drop(seen.wait_for(|view| view.ended.is_some()).await);
    Json(site.view.borrow().clone())
}

/// Sets up by a page, until its person ends it.
///
/// # Errors
/// An address that cannot be served, [`Stopped`], and a state that cannot be stored.
pub fn run(args: &Args, listen: SocketAddr, stopper: &Stopper) -> anyhow::Result<()> {
    let settings =
        HttpSettings { listen, token_file: args.token_file.clone(), allowed_hosts: args.allowed_host.clone(), ..HttpSettings::default() };
    let listener = http::bind(&settings)?;
    let address = listener.local_addr()?;
    let file = args.out.display().to_string();
    let view = Arc::new(watch::Sender::new(View { file, stages: STAGES, ..View::default() }));
    let (send, messages) = mpsc::channel();
    let runtime = tokio::runtime::Builder::new_multi_thread().worker_threads(1).enable_all().build().context("cannot start the runtime")?;
    let (shut, shutting) = oneshot::channel::<()>();
    let site = (view.clone(), stopper.clone());
    let served = runtime.spawn(async move {
        let routes = |guard, closing| {
            let (view, stopper) = site;
            http::guarded(routes(Site { view, messages: send, stopper, closing }), guard)
        };
        let shutdown = async {
            let _closed = shutting.await;
        };
        http::serve_routes(listener, &settings, routes, shutdown).await
    });
    say!("carved setup: open http://{address} in a browser. Ctrl-C ends the set-up and stops the motors.");
    let mut page = Page { view: view.clone(), messages, pending: None, refusal: None, asked: 0, exists: false };
    let done = talk(args, stopper, &mut page);
    let ended = match &done {
        Ok(summary) => Ended { is_done: true, text: summary.clone() },
        Err(error) => Ended { is_done: false, text: crate::cli::with_causes(error) },
    };
    page.change(|view| {
        (view.question, view.doing, view.taken, view.ended) = (None, None, None, Some(ended));
    });
    if let Ok(summary) = &done {
        stopper.finish();
        say!("{summary}\nThe page stays until it is closed there, or by Ctrl-C.");
        while !matches!(page.messages.recv(), Ok(Message::End) | Err(_)) {}
    }
    let _gone = shut.send(());
    runtime.block_on(served).context("the server of the page broke")??;
    done.map(|_| ())
}

/// Leads the conversation, and gives the summary.
fn talk(args: &Args, stopper: &Stopper, page: &mut Page) -> anyhow::Result<String> {
    let view = page.view.clone();
    let show = move |shown: Shown| {
        view.send_modify(|view| {
            view.jpeg = Some(shown.jpeg);
            view.taken = shown.taken;
            view.picture += 1;
            view.revision += 1;
        });
    };
    let mut work = Work::begin(args, stopper, Some(Box::new(show)))?;
    page.exists = work.bench.exists();
    #[cfg(feature = "simulate")]
    page.change(|view| view.simulated = work.emulated.as_ref().map(super::emulated::EmulatedRig::facts));
    let summary = work.converse(page)?;
    page.change(|view| Page::place(view, &work.machine, &Step::Finished));
    Ok(summary)
}
