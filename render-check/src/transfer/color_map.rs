//! Standard colour maps by name: matplotlib's, as nine colours each, linear between them.

use crate::error::RenderError;

/// A colour map.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ColorMap {
    name: &'static str,
    /// Evenly from 0 to 1, as 0xrrggbb.
    colors: &'static [u32],
}

const MAPS: [ColorMap; 6] = [
    ColorMap { name: "gray", colors: &[0x00_0000, 0xff_ffff] },
    ColorMap {
        name: "viridis",
        colors: &[
            0x44_0154, 0x47_2d7b, 0x3b_528b, 0x2c_728e, 0x21_918c, 0x28_ae80, 0x5e_c962, 0xad_dc30,
            0xfd_e725,
        ],
    },
    ColorMap {
        name: "magma",
        colors: &[
            0x00_0004, 0x1c_1044, 0x4f_127b, 0x81_2581, 0xb5_367a, 0xe5_5964, 0xfb_8761, 0xfe_c287,
            0xfc_fdbf,
        ],
    },
    ColorMap {
        name: "inferno",
        colors: &[
            0x00_0004, 0x1f_0c48, 0x55_0f6d, 0x88_226a, 0xba_3655, 0xe3_5933, 0xf9_8c0a, 0xf9_c932,
            0xfc_ffa4,
        ],
    },
    ColorMap {
        name: "plasma",
        colors: &[
            0x0d_0887, 0x4c_02a1, 0x7e_03a8, 0xaa_2395, 0xcc_4778, 0xe6_6c5c, 0xf8_9540, 0xfd_c527,
            0xf0_f921,
        ],
    },
    ColorMap {
        name: "coolwarm",
        colors: &[
            0x3b_4cc0, 0x62_82ea, 0x8d_b0fe, 0xb8_d0f9, 0xdd_dddd, 0xf5_c4ad, 0xf4_9a7b, 0xdd_5f4b,
            0xb4_0426,
        ],
    },
];

impl ColorMap {
    /// All there are.
    pub fn all() -> impl Iterator<Item = Self> {
        MAPS.into_iter()
    }

    /// Its name.
    pub fn name(self) -> &'static str {
        self.name
    }

    /// The map of a name.
    ///
    /// # Errors
    /// When there is none.
    pub fn find(name: &str) -> Result<Self, RenderError> {
        MAPS.into_iter().find(|map| map.name == name).ok_or_else(|| RenderError::ColorMap {
            found: name.to_owned(),
            known: MAPS.map(|map| map.name).join(", "),
        })
    }

    /// Where its colours lie, from 0 to 1.
    pub(crate) fn knots(self) -> impl Iterator<Item = f64> {
        let last = self.colors.len() - 1;
        (0..=last).map(move |i| i as f64 / last as f64)
    }

    /// The colour at a place from 0 to 1.
    pub fn at(self, place: f64) -> [f64; 3] {
        let last = self.colors.len() - 1;
        let x = place.clamp(0.0, 1.0) * last as f64;
        let i = (x as usize).min(last - 1);
        let t = x - i as f64;
        let part = |color: u32, c: usize| f64::from(color >> (16 - 8 * c) & 0xff) / 255.0;
        [0, 1, 2].map(|c| {
            let (a, b) = (part(self.colors[i], c), part(self.colors[i + 1], c));
            a + t * (b - a)
        })
    }
}
