//! Whether the devices are there: looked at while nothing runs, shown while something does.

use super::super::{Status, gate};
use super::super::{search, worker::Instrument};
use super::Running;
use super::background::BackgroundTask;
use carved_devices::DeviceError;
use carved_records::{CalibrationStatus, Device, fault_table};
use carved_store::calibrations;

impl Running {
    /// During a run the worker opens a lost camera again by itself, or ends; here it is shown.
    pub(super) fn show_camera(&self) {
        let is_lost = self.camera.is_lost();
        if self.publisher.status().hardware.camera.connected == is_lost {
            self.publish(|s| s.hardware.camera.connected = !is_lost);
        }
    }

    /// Shows whether the index holds all that is on disk.
    pub(super) fn show_index(&self) {
        let trouble = self.store.index_trouble();
        if self.publisher.status().hardware.index_trouble != trouble {
            self.publish(|s| s.hardware.index_trouble = trouble);
        }
    }

    /// At rest the devices are asked whether they are still there.
    pub(super) fn look(&mut self) {
        if self.task.is_some() || self.instrument.is_none() {
            return;
        }
        if self.camera.is_lost() {
            self.lose(Device::Camera, DeviceError::ControlLost);
        }
        self.task = self.instrument.take().map(|instrument| BackgroundTask::Search(search::begin(instrument)));
    }

    pub(super) fn searched(&mut self, instrument: Instrument, found: search::DevicesFound) {
        let identity = instrument.rig.rotation.identity().to_owned();
        let specimen = instrument.sampler.sees_specimen();
        self.instrument = Some(instrument);
        let was_lost = !self.lost.is_empty();
        match found.camera {
            Ok(()) => self.regain(Device::Camera, |s| s.hardware.camera.connected = true),
            Err(error) => tracing::debug!(%error, "the camera is not back yet"),
        }
        match found.rotation {
            Ok(()) => {
                self.regain(Device::Rotation, |s| s.hardware.find_axes(&identity));
                // A controller that was held when it was opened tells its version only once it is free.
                if self.publisher.status().hardware.rotation.identity.as_deref() != Some(&identity) {
                    self.publish(|s| s.hardware.find_axes(&identity));
                }
            }
            Err(error @ (DeviceError::Gone { .. } | DeviceError::Silent { .. })) => self.lose(Device::Rotation, error),
            Err(ref error @ DeviceError::Intervention { .. }) => self.axis_is_taken(Some(error)),
            Err(error @ DeviceError::Mismatch { .. }) => self.stands(fault_table::ROTATION_SETTINGS.code, error),
            Err(error) => tracing::debug!(%error, "the rotation axis is not back yet"),
        }
        self.unasked(specimen);
        // A run that was held by it may go on.
        if was_lost && self.lost.is_empty() {
            self.resume_by_itself();
        }
    }

    /// A person or a safety circuit has the axis. For as long as that lasts the fault stands, also where it was acknowledged before
    /// it was over. A lost axis counts as back only once it is free.
    pub(super) fn axis_is_taken(&mut self, intervention: Option<&DeviceError>) {
        if let Some(DeviceError::Intervention { device, what, way_out }) = intervention {
            let error = DeviceError::Intervention { device, what: what.clone(), way_out };
            self.stands(fault_table::ROTATION_INTERVENTION.code, error);
        }
    }

    /// Raises what a look has found, unless a fault of that code stands already.
    fn stands(&mut self, code: &str, error: DeviceError) {
        if self.state().faults.open().iter().all(|fault| fault.code != code) {
            self.raise(&error.into());
        }
    }

    /// A specimen in the capillary, by the sampler's wire, while there is no run and none was left there.
    fn unasked(&mut self, seen: Option<bool>) {
        let Some(seen) = seen.filter(|_| self.active.is_none() && self.capillary().inside().is_none()) else { return };
        if self.unasked != seen {
            self.unasked = seen;
            self.publish(|_| ());
        }
        if seen {
            self.stands(fault_table::SAMPLER_FAILED.code, DeviceError::Unasked);
        }
    }

    /// A loss at rest is a fault of its own, raised once.
    fn lose(&mut self, device: Device, error: DeviceError) {
        if !self.lost.contains(&device) {
            self.raise(&error.into());
        }
    }

    /// What is back is a fault no more.
    fn regain(&mut self, device: Device, connected: impl FnOnce(&mut Status)) {
        if self.lost.contains(&device) {
            self.lost.retain(|lost| *lost != device);
            self.fault_over(|fault| device.is_all_of(fault), device.is_back(), connected);
        }
    }

    /// The rig's newest calibration, from disk.
    pub(super) fn calibration(&self) -> Option<CalibrationStatus> {
        let config = &self.config;
        let found = calibrations::newest(&config.calibrations(), &config.rig_name, self.mode).unwrap_or_else(|error| {
            tracing::warn!(%error, "the rig's calibrations are not read");
            None
        });
        let size = found.map(|found| found.status(config.calibration.max_age_days, jiff::Timestamp::now()));
        gate::beside(size, gate::newest(config, self.mode))
    }

    /// A calibration, or a gate, that has grown too old is a change of state, and told as one.
    pub(super) fn calibration_ages(&self) {
        let mut calibration = self.publisher.status().calibration.clone();
        if calibration.as_mut().is_some_and(|c| c.grows_too_old(jiff::Timestamp::now())) {
            self.publish(|s| s.calibration = calibration);
        }
    }
}
