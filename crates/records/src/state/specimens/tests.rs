//! A model check: every state that a plate of two larvae can lead to, whatever happens and in whatever order, with crashes at every moment.
//! The truth (which larva is where) runs beside what the specimens' states say. The search ends when no step leads to a new state.
//!
//! ```text
//! World ── worker, loader, sampler, person, fault, restart ──► every next World ──► checked: one specimen at most, the right larva is
//!                                                                                   worked on, somebody who reads the status gets on
//! ```

use super::*;
use SpecimenEvent as On;
use std::collections::{BTreeSet, VecDeque};

const WELLS: [&str; 2] = ["A01", "A02"];
/// Steps within which somebody who does what the status says has the plate.
const STEPS: usize = 80;

/// Who fills the capillary.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Filling {
    Loader,
    /// A driven sampler that brings the larva of a well.
    ByWell,
    /// A driven sampler that brings the next larva of its plate, once.
    InOrder,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Worker {
    /// Between two wells.
    Between,
    Loading(usize),
    Working(usize),
    Ejecting(usize),
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Run {
    Works(Worker),
    Paused,
    Over,
}

/// A message of the loader on its way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Message {
    In(usize),
    Out(usize),
}

/// How an interruption leaves the specimen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Fate {
    PoseLost,
    Stays,
}

#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
struct World {
    filling: Filling,
    believed: Specimens,
    run: Run,
    /// The wells with an outcome, and those of which only the numbers may be missing.
    done: [bool; 2],
    accepted: [bool; 2],
    /// What a worker was given when it began: what it ejects first, what it continues with, what was asked for before a restart.
    given: [Option<usize>; 3],
    /// The truth: the larva in the capillary, those on the plate, and the one that the sampler is about to bring.
    inside: Option<usize>,
    on_plate: [bool; 2],
    coming: Option<usize>,
    /// That larva is from a plate before.
    is_of_last_plate: bool,
    /// The sampler's memory: the next arrival was asked for; a specimen came and left while nothing ran.
    arrival_counts: bool,
    visitor_left: bool,
    messages: Vec<Message>,
}

fn place(well: &str) -> usize {
    WELLS.iter().position(|known| *known == well).unwrap()
}

impl World {
    fn new(filling: Filling) -> Self {
        let run = Run::Works(Worker::Between);
        Self {
            filling,
            believed: Specimens::none(),
            run,
            done: [false; 2],
            accepted: [false; 2],
            given: [None; 3],
            inside: None,
            on_plate: [true; 2],
            coming: None,
            is_of_last_plate: false,
            arrival_counts: false,
            visitor_left: false,
            messages: Vec::new(),
        }
    }

    fn situation(&self) -> Situation {
        Situation {
            loaded_by: if self.is_driven() { LoadedBy::Sampler } else { LoadedBy::Loader },
            brings_again: self.filling != Filling::InOrder,
            work: match self.run {
                Run::Works(_) => Work::InProgress,
                Run::Paused => Work::Paused,
                Run::Over => Work::Over,
            },
        }
    }

    fn is_driven(&self) -> bool {
        self.filling != Filling::Loader
    }

    fn happens(&mut self, well: usize, event: SpecimenEvent) {
        self.believed.happens(WELLS[well], event);
    }

    /// The larva leaves the capillary. If it can come again, it is back in its well.
    fn empty(&mut self) {
        if let Some(larva) = self.inside.take()
            && !std::mem::take(&mut self.is_of_last_plate)
        {
            self.on_plate[larva] = self.filling != Filling::InOrder;
        }
    }

    /// As `course::launch`.
    fn launched(mut self) -> Self {
        let of = |well: Option<&str>| well.map(place);
        let [must_leave, kept] = [self.believed.must_leave_first(self.situation().loaded_by), self.believed.continued_with()].map(of);
        self.given = if self.is_driven() { [must_leave, kept, of(self.believed.unknown())] } else { [None; 3] };
        self.run = Run::Works(Worker::Between);
        self
    }

    /// The worker ends. As `course::interrupt_specimens`.
    fn interrupted(mut self, fate: Fate) -> Self {
        let worked_on: Vec<(usize, Specimen)> = self.believed.worked_on().map(|(well, found)| (place(well), found)).collect();
        let accepted = self.accepted;
        for (well, specimen) in worked_on.into_iter().filter(|(well, _)| !accepted[*well]) {
            if fate == Fate::Stays && specimen.state().is_inside() {
                self.happens(well, On::StaysInside);
            } else {
                self.done[well] |= !self.situation().brings_again;
                self.happens(well, On::Interrupted);
            }
        }
        (self.run, self.given) = (Run::Paused, [None; 3]);
        self
    }

    /// The run is held, once the worker has ended. As `course::rest`.
    fn held(self, fate: Fate) -> Self {
        let mut held = self.interrupted(fate);
        held.believed.happens_to_all(On::Held);
        held
    }

    /// A run of another plate is accepted, as `requests::begin`.
    fn next_run(mut self) -> Option<Self> {
        let may_begin = self.run == Run::Over && self.messages.is_empty();
        let keeps_out = if self.is_driven() { self.believed.unknown() } else { self.believed.inside() };
        if !may_begin || keeps_out.is_some() {
            return None;
        }
        self.is_of_last_plate = self.inside.is_some() || self.coming.is_some();
        self.believed = Specimens::of_new_run(self.believed.inside());
        (self.done, self.accepted, self.on_plate) = ([false; 2], [false; 2], [true; 2]);
        (self.arrival_counts, self.visitor_left) = (false, false);
        Some(self.launched())
    }

    /// After the last well, or as a stop or an abort has it.
    fn over(mut self) -> Self {
        self.believed.happens_to_all(On::Ended);
        if self.is_driven() {
            self.believed.happens_to_all(On::EndedWhileAsked);
        }
        (self.run, self.given) = (Run::Over, [None; 3]);
        self
    }

    fn sampler_failed(mut self) -> Self {
        self.believed.happens_to_all(On::SamplerFailed);
        let is_late = self.believed.iter().all(|(_, found)| !matches!(found.state(), SpecimenState::Loading | SpecimenState::Coming));
        assert!(is_late, "what comes now belongs to no well: {self:#?}");
        self.held(Fate::PoseLost)
    }

    fn restarted(mut self) -> Self {
        // A run that has ended is shown again as it was.
        if self.run == Run::Over {
            return self;
        }
        self.believed.happens_to_all(if self.is_driven() { On::RestartedWithSampler } else { On::RestartedWithLoader });
        (self.arrival_counts, self.visitor_left) = (false, false);
        let restarted = self.interrupted(Fate::PoseLost);
        // A start asks the sampler again for what it was asked for. What is inside and not gone on with leaves first.
        for (_, found) in restarted.believed.iter() {
            assert!(!matches!(found.state(), SpecimenState::Coming | SpecimenState::Measured), "{restarted:#?}");
        }
        restarted
    }

    /// The next step of the worker. `None` if it waits.
    fn worked(mut self, at: Worker) -> Option<Self> {
        match at {
            Worker::Between => {
                if let Some(left) = self.given[0].take() {
                    self.happens(left, On::EjectBegun);
                    self.empty();
                    self.happens(left, On::Out);
                    self.arrival_counts = true;
                    return Some(self);
                }
                let is_open = |well: &usize| !self.done[*well] && !self.accepted[*well];
                let kept = self.given[1].filter(is_open);
                let Some(well) = kept.or_else(|| (0..2).find(is_open)) else {
                    return self.done.iter().all(|done| *done).then(|| self.over());
                };
                self.given[1] = None;
                self.happens(well, On::LoadBegun);
                self.run = Run::Works(Worker::Loading(well));
                if !self.is_driven() {
                    if self.believed.continued_with() != Some(WELLS[well]) {
                        self.happens(well, On::AskedFor);
                    }
                    return Some(self);
                }
                if kept.is_some() {
                    // As `go_on`: the sensor must show one.
                    return Some(if self.inside.is_some() { self } else { self.sampler_failed() });
                }
                self.arrival_counts |= self.given[2].take() == Some(well);
                let counts = std::mem::take(&mut self.arrival_counts) && !std::mem::take(&mut self.visitor_left);
                if !counts && self.inside.is_some() {
                    return Some(self.sampler_failed());
                }
                if self.inside.is_none() && self.coming.is_none() {
                    let next = if self.filling == Filling::ByWell { Some(well) } else { Some(0) };
                    self.coming = next.and_then(|from| (from..2).find(|larva| self.on_plate[*larva]));
                    self.coming = self.coming.filter(|larva| self.filling == Filling::InOrder || *larva == well);
                }
                Some(self)
            }
            Worker::Loading(well) => {
                let is_there = if self.is_driven() { self.inside.is_some() } else { self.believed.continued_with() == Some(WELLS[well]) };
                if !is_there {
                    return None;
                }
                let state = self.believed.of(WELLS[well]).state();
                assert!(state.may_be_worked_on(), "work on a specimen in the state {state:?}: {self:#?}");
                assert!(self.inside == Some(well) && !self.is_of_last_plate, "work on another larva: {self:#?}");
                self.happens(well, On::WorkBegun);
                self.run = Run::Works(Worker::Working(well));
                Some(self)
            }
            Worker::Working(well) => {
                self.accepted[well] = true;
                self.happens(well, On::EjectBegun);
                self.run = Run::Works(Worker::Ejecting(well));
                Some(self)
            }
            Worker::Ejecting(well) => {
                if self.is_driven() {
                    self.empty();
                    self.happens(well, On::Out);
                    self.arrival_counts = true;
                }
                self.run = Run::Works(Worker::Between);
                Some(self)
            }
        }
    }

    /// The loader does what it is asked for. Its message follows later.
    fn loader_moved(mut self) -> Option<Self> {
        let requests = self.believed.requests(self.situation());
        let (out, into) = (requests.take_out.map(place), requests.bring.map(place));
        if self.is_driven() || !self.messages.is_empty() {
            return None;
        }
        let message = into.map(Message::In).or(out.map(Message::Out))?;
        assert!(out.is_some() || self.inside.is_none(), "it brings one to another: {self:#?}");
        self.empty();
        if let Some(larva) = into {
            (self.inside, self.on_plate[larva]) = (Some(larva), false);
        }
        self.messages.push(message);
        Some(self)
    }

    /// The loader's oldest message arrives.
    fn told(mut self) -> Option<Self> {
        let message = self.messages.first().copied()?;
        self.messages.remove(0);
        let (Message::In(well) | Message::Out(well)) = message;
        let situation = self.situation();
        let is_in = matches!(message, Message::In(_));
        let report =
            if is_in { self.believed.report_in(WELLS[well], situation) } else { self.believed.report_out(WELLS[well], true, situation) };
        match report {
            Ok(Report::News { .. }) => self.happens(well, if is_in { On::ReportedIn } else { On::ReportedOut }),
            Ok(Report::Known) => {}
            // The run has ended meanwhile, so each specimen needs its own message.
            Err(NotNow::Full(inside)) => self.messages = vec![Message::Out(place(inside)), message],
            Err(NotNow::Unexpected) => panic!("an honest message is refused: {message:?} {self:#?}"),
        }
        Some(self)
    }

    /// A person empties a driven sampler's capillary while nothing works, and reports it. A larva of a plate before that nobody knows of has
    /// no well.
    fn emptied_by_hand(mut self) -> Option<Self> {
        let larva = self.inside.filter(|_| self.is_driven() && !matches!(self.run, Run::Works(_)))?;
        let is_of_no_well = self.is_of_last_plate && self.believed.inside() != Some(WELLS[larva]);
        self.empty();
        self.visitor_left = true;
        Some(if is_of_no_well { self } else { self.reported_out_by_hand(larva) })
    }

    fn reported_out_by_hand(mut self, well: usize) -> Self {
        let is_of_earlier_run = self.believed.of(WELLS[well]).state() == SpecimenState::OfEarlierRun;
        match self.believed.report_out(WELLS[well], true, self.situation()) {
            Ok(Report::News { .. }) => {
                self.happens(well, On::ReportedOut);
                // As `course::taken_for_good`.
                if !is_of_earlier_run && self.run != Run::Over && !self.accepted[well] && !self.situation().brings_again {
                    self.done[well] = true;
                    self.happens(well, On::Interrupted);
                }
            }
            Ok(Report::Known) => {}
            Err(refused) => panic!("a person's report is refused: {refused:?} {self:#?}"),
        }
        let state = self.believed.of(WELLS[well]).state();
        let is_out = match state {
            SpecimenState::Gone => true,
            SpecimenState::Released => self.accepted[well],
            SpecimenState::Absent => is_of_earlier_run,
            _ => false,
        };
        assert!(is_out, "{state:?} is not out: {self:#?}");
        self
    }

    fn arrived(mut self) -> Option<Self> {
        let larva = self.coming.filter(|_| self.inside.is_none())?;
        (self.coming, self.inside) = (None, Some(larva));
        self.on_plate[larva] &= self.is_of_last_plate;
        Some(self)
    }

    /// The numbers of an accepted specimen are there. It has left, or the loader takes it out.
    fn measured(mut self) -> Option<Self> {
        let at_eject = |well: usize| self.run == Run::Works(Worker::Ejecting(well));
        let well = (0..2).find(|well| self.accepted[*well] && !self.done[*well] && !at_eject(*well))?;
        self.happens(well, On::Done);
        self.done[well] = true;
        Some(self)
    }

    /// As `course::proceed`.
    fn unheld(mut self) -> Option<Self> {
        if self.run != Run::Paused {
            return None;
        }
        for well in (0..2).filter(|well| self.accepted[*well] && !self.done[*well]).collect::<Vec<_>>() {
            self.happens(well, On::NumbersFollow);
        }
        let must_leave = self.believed.must_leave_first(LoadedBy::Loader).is_some() && !self.is_driven();
        Some(if must_leave { self } else { self.launched() })
    }

    /// Everything that can happen next.
    fn next(&self) -> Vec<Self> {
        let mut next = vec![self.clone().restarted()];
        next.push(self.clone().over());
        next.extend([self.clone().arrived(), self.clone().loader_moved(), self.clone().told()].into_iter().flatten());
        next.extend([self.clone().emptied_by_hand(), self.clone().unheld(), self.clone().measured()].into_iter().flatten());
        next.extend(self.clone().next_run());
        match self.run {
            Run::Works(at) => {
                next.extend(self.clone().worked(at));
                for fate in [Fate::PoseLost, Fate::Stays] {
                    let mut cut_short = self.clone();
                    cut_short.arrival_counts |= matches!(at, Worker::Loading(_));
                    next.push(cut_short.held(fate));
                }
                // No specimen in time, or one that does not leave.
                let stuck = matches!(at, Worker::Ejecting(_)) || at == Worker::Between && self.given[0].is_some();
                if self.is_driven() && (stuck || matches!(at, Worker::Loading(_)) && self.inside.is_none()) {
                    next.push(self.clone().sampler_failed());
                }
            }
            Run::Paused | Run::Over => {}
        }
        next
    }

    /// What the states say is true.
    fn check(&self) {
        use SpecimenState::{
            Absent, Asked, Awaited, Coming, Gone, Late, Leaving, Loading, Measured, Released, Unknown, Untouched, WorkedOn,
        };
        let state = |well: usize| self.believed.of(WELLS[well]).state();
        let inside = (0..2).filter(|well| state(*well).is_inside()).count();
        assert!(inside <= 1, "two specimens: {self:#?}");
        for (well, name) in WELLS.iter().enumerate() {
            let (state, is_told) = (state(well), self.messages.is_empty());
            // The states are about the larvae of this plate.
            let is_at = |place: Option<usize>| place == Some(well) && !self.is_of_last_plate;
            let (is_inside, is_coming) = (is_at(self.inside), is_at(self.coming));
            let claims = match state {
                Loading | Coming | Late | Unknown => self.is_driven() || !is_inside,
                Absent | Asked | Awaited | Released | Gone => !is_told || !is_inside && !is_coming,
                _ => !is_told || self.inside == Some(well),
            };
            assert!(claims, "{name} is not {state:?}: {self:#?}");
            let is_awaited = matches!(state, Loading | Awaited | Untouched);
            assert!(!is_awaited || matches!(self.run, Run::Works(_)), "no worker is about to begin with {state:?}: {self:#?}");
            assert!(state != Measured || self.done[well], "its well is not done: {self:#?}");
            assert!(!self.done[well] || !state.is_begun(), "its well is done: {self:#?}");
            let is_as_the_worker_is = match self.run {
                Run::Works(Worker::Loading(at)) if at == well => is_awaited,
                Run::Works(Worker::Working(at)) if at == well => state == WorkedOn,
                Run::Works(Worker::Ejecting(at)) if at == well => matches!(state, Leaving | Released),
                // The specimen of a well that only lacks its numbers.
                Run::Paused => !matches!(state, WorkedOn | Leaving | Released) || self.accepted[well],
                Run::Works(_) => state != WorkedOn && (state != Leaving || self.accepted[well]),
                Run::Over => !state.is_begun(),
            };
            assert!(is_as_the_worker_is, "{state:?} is not what is done: {self:#?}");
        }
        let requests = self.believed.requests(self.situation());
        let is_named = self.run != Run::Over || requests.take_out == self.believed.inside();
        assert!(is_named, "nobody is told to take out what keeps the plate: {self:#?}");
    }

    /// Loader, sampler and a person who read the status, and nothing else happens. `None` once the plate can be taken.
    fn leads_on(self) -> Option<Self> {
        if let Some(told) = self.clone().told().or_else(|| self.clone().loader_moved()) {
            return Some(told);
        }
        match self.run {
            Run::Works(at) => {
                let worked = self.clone().worked(at).or_else(|| self.clone().arrived()).or_else(|| self.clone().measured());
                Some(worked.unwrap_or_else(|| self.sampler_failed()))
            }
            Run::Paused if self.is_driven() => {
                let late = self.believed.iter().find(|(_, found)| found.state() == SpecimenState::Late).map(|(well, _)| place(well));
                match (self.inside, late) {
                    // The fault says that nobody asked for it, or that it came late.
                    (Some(larva), _) if self.believed.inside() != Some(WELLS[larva]) => self.emptied_by_hand(),
                    (None, Some(late)) if self.coming.is_none() && !self.on_plate[late] => {
                        let mut given_up = self.reported_out_by_hand(late);
                        // Where it can be brought again, the person puts another larva into its well.
                        given_up.on_plate[late] |= given_up.filling == Filling::ByWell;
                        given_up.unheld()
                    }
                    _ => self.unheld(),
                }
            }
            Run::Paused => self.unheld(),
            Run::Over => {
                let out = self.believed.requests(self.situation()).take_out.map(place)?;
                if let Some(arrived) = self.clone().arrived() {
                    return Some(arrived);
                }
                if self.inside.is_some() { self.emptied_by_hand() } else { Some(self.reported_out_by_hand(out)) }
            }
        }
    }
}

/// All states that follow, with the shortest way to each.
fn every_state(filling: Filling) -> BTreeSet<World> {
    let first = World::new(filling);
    let mut seen = BTreeSet::from([first.clone()]);
    let mut waiting = VecDeque::from([first]);
    while let Some(world) = waiting.pop_front() {
        for next in world.next() {
            next.check();
            if seen.insert(next.clone()) {
                waiting.push_back(next);
            }
        }
    }
    seen
}

#[test]
fn no_order_of_events_puts_two_specimens_inside_works_on_the_wrong_one_or_leads_to_a_dead_end() {
    for filling in [Filling::Loader, Filling::ByWell, Filling::InOrder] {
        let worlds = every_state(filling);
        assert!(worlds.len() > 100, "{filling:?}: {}", worlds.len());
        for first in &worlds {
            let mut world = first.clone();
            let mut steps = 0;
            while let Some(next) = world.clone().leads_on() {
                assert_ne!(next, world, "a dead end after {steps} steps from {first:#?}");
                (world, steps) = (next, steps + 1);
                assert!(steps < STEPS, "no end from {first:#?}, at {world:#?}");
            }
            assert_eq!((world.run, world.believed.inside()), (Run::Over, None), "from {first:#?}");
        }
    }
}

/// Every state that events lead to is one that a person can lead out of, and the table has no transition that nothing takes.
#[test]
fn the_search_meets_every_state_of_a_specimen_that_a_run_asks_for() {
    let met: BTreeSet<SpecimenState> = [Filling::Loader, Filling::ByWell, Filling::InOrder]
        .into_iter()
        .flat_map(every_state)
        .flat_map(|world| world.believed.iter().map(|(_, found)| found.state()).collect::<Vec<_>>())
        .collect();
    let not_met: Vec<SpecimenState> = SpecimenState::ALL.iter().copied().filter(|state| !met.contains(state)).collect();
    // It is in no well: the sensor shows it.
    assert_eq!(not_met, [SpecimenState::Unasked]);
}
