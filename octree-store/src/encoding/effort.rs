//! How much work goes into making payloads small.

use serde::{Deserialize, Serialize};

/// How much work goes into making payloads small; a reader need not know it.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Effort {
    /// Payloads are stored as they are: the fastest to write and to read.
    Fast,
    /// LZ4 where a trial says that it gains: the noise of scanners it leaves alone.
    #[default]
    Balanced,
    /// Zstandard, whose entropy coding gains on noise too: smaller, and slower to write and to read.
    Small,
}

impl Effort {
    /// The name used on the command line and in JSON.
    pub fn name(self) -> &'static str {
        match self {
            Self::Fast => "fast",
            Self::Balanced => "balanced",
            Self::Small => "small",
        }
    }
}
