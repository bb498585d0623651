//! The differences between grblHAL and the 8-bit Grbl from which it was developed.
//!
//! ```text
//!                      Grbl 1.1h     grblHAL 1.1f
//!   receive buffer     128 bytes     1024 bytes
//!   planner            15 blocks     100 blocks
//!   after an error     nothing       every line of G-code repeats it, until an empty line, a $ command or 0x18
//!   0x87               dropped       a report with every field
//!   changed modes      not reported  [GC:...] before the next report, without a request
//! ```

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Dialect {
    Grbl,
    GrblHal,
}

impl Dialect {
    pub fn is_hal(self) -> bool {
        self == Self::GrblHal
    }

    pub fn receive_bytes(self) -> usize {
        match self {
            Self::Grbl => 128,
            Self::GrblHal => 1024,
        }
    }

    /// Blocks that fit into the planner. A ring of 16 blocks is full with 15.
    pub fn planner_blocks(self) -> usize {
        match self {
            Self::Grbl => 15,
            Self::GrblHal => 100,
        }
    }

    pub fn greeting(self) -> &'static str {
        match self {
            Self::Grbl => "\r\nGrbl 1.1h ['$' for help]\r\n",
            Self::GrblHal => "\r\nGrblHAL 1.1f ['$' or '$HELP' for help]\r\n",
        }
    }

    pub fn version(self) -> &'static str {
        match self {
            Self::Grbl => "[VER:1.1h.20190825:]\r\n[OPT:V,15,128]\r\n",
            Self::GrblHal => "[VER:1.1f.20240301:]\r\n[OPT:VNMSL,100,1024,3,0]\r\n[NEWOPT:RT+,SED]\r\n[FIRMWARE:grblHAL]\r\n",
        }
    }
}
