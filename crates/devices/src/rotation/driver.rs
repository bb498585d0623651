//! The registry of the controllers: the one list from which configuration, `carved doctor`, `carved setup`, `carved simulate` and the
//! tests take them.
//!
//! ```text
//! NAME/settings.rs  impl Driver: ranges, check, open, port, outputs ─┐
//! NAME/entry.rs     ENTRY: example, identification, set-up ──────────┴─► drivers! ─┬─► RotationDriver   the table `[rotation]`
//!                                                                                  └─► DRIVERS          what each make states of itself
//! ```

use super::identify::{Answer, Wire};
use super::{Port, TranslationSettings};
use super::{bridge, grbl, relay, tmcl, zaber};
use crate::outputs::OutputStatus;
use crate::views::FolderSettings;
use crate::{DeviceError, RotationAxis};
use carved_core::range::{OutOfRange, outside_in};
use carved_core::units::StepsPerRevolution;
use serde::Deserialize;
use serde::de::{self, EnumAccess, VariantAccess, Visitor};

/// The settings of a controller.
pub trait Driver: std::fmt::Debug + Send + Sync {
    /// Every number that is out of its range.
    fn out_of_range(&self) -> Vec<OutOfRange>;
    /// Checks the settings on a rig with these motor steps.
    ///
    /// # Errors
    /// The first setting that the controller does not support.
    fn check_on(&self, per_revolution: StepsPerRevolution) -> Result<(), DeviceError>;
    /// Opens the controller. Nothing moves.
    ///
    /// # Errors
    /// A port that cannot be opened, and a controller that does not answer or has other settings.
    fn open(
        &self,
        per_revolution: StepsPerRevolution,
        translation: Option<TranslationSettings>,
    ) -> Result<Box<dyn RotationAxis>, DeviceError>;
    /// Opens the port and writes the stop. Nothing is asked: opening waits for a controller that moves, and refuses one with other settings.
    /// Nothing happens where no stop can be written.
    ///
    /// # Errors
    /// A port that cannot be opened or written to.
    fn stop(&self) -> Result<(), DeviceError> {
        Ok(())
    }
    /// The serial port and its baud rate. `None` for a controller that is not on one.
    fn serial(&self) -> Option<(&Port, u32)>;
    /// Replaces the port or the address.
    fn connect_to(&mut self, address: String);
    /// The outputs, with unknown states.
    fn outputs(&self) -> Vec<OutputStatus> {
        Vec::new()
    }
}

/// What a make of controller states of itself, in its own folder.
#[derive(Debug)]
pub struct Entry {
    /// The value of `driver` in `[rotation]`.
    pub name: &'static str,
    /// Its configuration in `config/`.
    pub example: Example,
    /// How it is found on a serial port. `None` if it is not on one.
    pub serial: Option<Serial>,
    /// How `carved setup` sets it up, or why it cannot.
    pub setup: Result<Setup, &'static str>,
    /// Motor steps and turns of a machine that has no others. `None` if they depend on the rig.
    pub fixed_steps: Option<[u32; 2]>,
}

/// A shipped configuration.
#[derive(Debug)]
pub struct Example {
    /// Name of the file.
    pub file: &'static str,
    /// Its text.
    pub text: &'static str,
}

/// How a controller is found on a serial port.
#[derive(Debug)]
pub struct Serial {
    /// Name of the protocol, for a person.
    pub protocol: &'static str,
    /// Asks whether this controller is there. `None` if something else answers, or nothing.
    pub identify: fn(&mut Wire) -> Result<Option<Answer>, DeviceError>,
}

/// What `carved setup` asks about a controller.
#[derive(Debug)]
pub struct Setup {
    /// It can search a home switch, or take its position at the start as step 0.
    pub can_home: bool,
    /// Usual motor steps of a turn.
    pub usual_steps: &'static str,
    /// Outputs at which a light can be: the value of `pin`, and its meaning.
    pub lights: &'static [(&'static str, &'static str)],
}

/// Every driver, in the order in which a serial port is asked for them. A driver that a test has added is asked for last.
pub fn drivers() -> impl Iterator<Item = &'static Entry> {
    let drivers = DRIVERS.iter().copied();
    #[cfg(any(test, feature = "testing"))]
    let drivers = drivers.chain(super::added::entries());
    drivers
}

/// The entry of a driver. `None` if there is no such driver.
pub fn entry(name: &str) -> Option<&'static Entry> {
    drivers().find(|entry| entry.name == name)
}

/// What the settings of every controller have in common that is on a serial port, homes and has outputs. `$open` opens the controller,
/// and `$link` its port only.
macro_rules! serial_driver {
    ($settings:ty, $link:expr, $open:expr) => {
        impl $crate::rotation::driver::Driver for $settings {
            fn out_of_range(&self) -> Vec<carved_core::range::OutOfRange> {
                carved_core::range::Ranged::outside(self)
            }

            fn check_on(&self, _: carved_core::units::StepsPerRevolution) -> Result<(), $crate::DeviceError> {
                self.check()
            }

            fn open(
                &self,
                _: carved_core::units::StepsPerRevolution,
                translation: Option<$crate::rotation::TranslationSettings>,
            ) -> Result<Box<dyn $crate::RotationAxis>, $crate::DeviceError> {
                let open: fn(Self, Option<$crate::rotation::TranslationSettings>) -> _ = $open;
                Ok(Box::new(open(self.clone(), translation)?))
            }

            fn stop(&self) -> Result<(), $crate::DeviceError> {
                let link: fn(&Self) -> Result<$crate::rotation::link::Link, $crate::DeviceError> = $link;
                link(self)?.write_stop()
            }

            fn serial(&self) -> Option<(&$crate::rotation::Port, u32)> {
                Some((&self.port, self.baud))
            }

            fn connect_to(&mut self, address: String) {
                self.port = $crate::rotation::Port::Path(address);
            }

            fn outputs(&self) -> Vec<$crate::outputs::OutputStatus> {
                $crate::outputs::unknown(&self.outputs)
            }
        }

        impl $settings {
            pub(in crate::rotation) fn answer_timeout(&self) -> std::time::Duration {
                std::time::Duration::from_millis(self.answer_timeout_ms.into())
            }

            pub(in crate::rotation) fn homing_timeout(&self) -> std::time::Duration {
                std::time::Duration::from_millis(self.homing_timeout_ms.into())
            }
        }
    };
}
pub(super) use serial_driver;

macro_rules! drivers {
    ($($(#[doc = $doc:literal])+ $variant:ident($make:ident::$settings:ident)),+ $(,)?) => {
        /// Which controller turns the capillary.
        #[derive(Debug, Clone)]
        #[cfg_attr(feature = "schema", derive(schemars::JsonSchema), schemars(tag = "driver", rename_all = "snake_case"))]
        pub enum RotationDriver {
            $($(#[doc = $doc])+ $variant($make::$settings),)+
            /// Another program, by `[views]`.
            #[cfg_attr(feature = "schema", schemars(skip))]
            Folder(FolderSettings),
            /// A driver that a test has added to the registry.
            #[cfg(any(test, feature = "testing"))]
            #[cfg_attr(feature = "schema", schemars(skip))]
            Added(super::added::Added),
        }

        impl<'de> Visitor<'de> for OfItsName {
            type Value = RotationDriver;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("the settings of a driver, below its name")
            }

            fn visit_enum<A: EnumAccess<'de>>(self, data: A) -> Result<RotationDriver, A::Error> {
                let (name, settings) = data.variant::<String>()?;
                $(if name == $make::ENTRY.name {
                    return settings.newtype_variant().map(RotationDriver::$variant);
                })+
                #[cfg(any(test, feature = "testing"))]
                if entry(&name).is_some() {
                    let keys = settings.newtype_variant()?;
                    return super::added::Added::read(&name, keys).map(RotationDriver::Added).map_err(de::Error::custom);
                }
                Err(de::Error::unknown_variant(&name, &[$($make::ENTRY.name),+]))
            }
        }

        /// The drivers of the list, in its order.
        pub const DRIVERS: &[&Entry] = &[$(&$make::ENTRY),+];

        impl RotationDriver {
            /// What the make states of itself. `None` if another program turns the capillary.
            pub fn entry(&self) -> Option<&'static Entry> {
                match self {
                    $(Self::$variant(_) => Some(&$make::ENTRY),)+
                    Self::Folder(_) => None,
                    #[cfg(any(test, feature = "testing"))]
                    Self::Added(added) => Some(added.entry()),
                }
            }

            fn driver(&self) -> Option<&dyn Driver> {
                match self {
                    $(Self::$variant(settings) => Some(settings),)+
                    Self::Folder(_) => None,
                    #[cfg(any(test, feature = "testing"))]
                    Self::Added(added) => Some(added.settings()),
                }
            }

            fn driver_mut(&mut self) -> Option<&mut (dyn Driver + 'static)> {
                match self {
                    $(Self::$variant(settings) => Some(settings),)+
                    Self::Folder(_) => None,
                    #[cfg(any(test, feature = "testing"))]
                    Self::Added(added) => added.settings_mut(),
                }
            }
        }
    };
}

// The order is that of the questions on a serial port: `identify.rs` has the reasons.
drivers! {
    /// Grbl 1.1 or grblHAL.
    Grbl(grbl::GrblSettings),
    /// A Zaber controller with the ASCII protocol.
    Zaber(zaber::ZaberSettings),
    /// A stock VAST behind a trigger bridge.
    VastBridge(bridge::VastBridgeSettings),
    /// A Trinamic module with TMCL firmware, two of whose motors hold the capillary at both ends.
    Tmcl(tmcl::TmclSettings),
    /// A stock VAST behind a relay: a program beside VAST's own library.
    Relay(relay::RelaySettings),
}

/// Reads settings by the name of their entry.
struct OfItsName;

impl<'de> Deserialize<'de> for RotationDriver {
    fn deserialize<D: de::Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        deserializer.deserialize_enum("RotationDriver", &[], OfItsName)
    }
}

impl RotationDriver {
    /// Every number that is out of its range, with the full path of its key.
    pub fn outside(&self) -> Vec<OutOfRange> {
        match (self, self.driver()) {
            (_, Some(driver)) => driver.out_of_range().into_iter().map(|breach| breach.below("rotation")).collect(),
            (Self::Folder(settings), _) => outside_in("views", settings).collect(),
            _ => Vec::new(),
        }
    }

    /// Checks the settings of the driver.
    ///
    /// # Errors
    /// The first setting that the controller does not support.
    pub fn check(&self, per_revolution: StepsPerRevolution) -> Result<(), DeviceError> {
        match (self, self.driver()) {
            (_, Some(driver)) => driver.check_on(per_revolution),
            (Self::Folder(settings), _) => settings.check(),
            _ => Ok(()),
        }
    }

    /// Opens the controller. Nothing moves. `None` if another program turns the capillary.
    ///
    /// # Errors
    /// A port that cannot be opened, and a controller that does not answer or has other settings.
    pub fn open(
        &self,
        per_revolution: StepsPerRevolution,
        translation: Option<TranslationSettings>,
    ) -> Option<Result<Box<dyn RotationAxis>, DeviceError>> {
        self.driver().map(|driver| driver.open(per_revolution, translation))
    }

    /// Opens the port and writes the stop, without a question to the controller. Nothing happens where no stop can be written.
    ///
    /// # Errors
    /// A port that cannot be opened or written to.
    pub fn stop(&self) -> Result<(), DeviceError> {
        self.driver().map_or(Ok(()), Driver::stop)
    }

    /// The serial port and its baud rate. `None` for a controller that is not on one.
    pub fn serial(&self) -> Option<(&Port, u32)> {
        self.driver()?.serial()
    }

    /// Replaces the port or the address. Nothing changes if another program turns the capillary.
    pub fn connect_to(&mut self, address: String) {
        if let Some(driver) = self.driver_mut() {
            driver.connect_to(address);
        }
    }

    /// The outputs of the controller, with unknown states.
    pub fn outputs(&self) -> Vec<OutputStatus> {
        self.driver().map_or_else(Vec::new, Driver::outputs)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The name in the entry is the one that the configuration reads, and the example is one of its driver.
    #[test]
    fn every_entry_is_that_of_the_driver_in_its_example() {
        #[derive(Deserialize)]
        struct Shipped {
            rotation: toml::Table,
        }
        for entry in DRIVERS {
            let mut keys = toml::from_str::<Shipped>(entry.example.text).unwrap().rotation;
            let driver = keys.remove("driver").unwrap();
            assert_eq!(driver.as_str(), Some(entry.name), "{}", entry.example.file);
            let tagged = toml::Table::from_iter([(entry.name.to_owned(), toml::Value::Table(keys))]);
            let read = RotationDriver::deserialize(toml::Value::Table(tagged)).unwrap();
            assert_eq!(read.entry().unwrap().name, entry.name);
            assert_eq!(
                read.serial().is_some(),
                entry.serial.is_some(),
                "{}: a port, but no way to find it, or the other way round",
                entry.name
            );
        }
    }
}
