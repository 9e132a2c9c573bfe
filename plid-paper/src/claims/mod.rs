//! The figures and claims, with one file for each.

mod converge;
mod db46;
mod drift;
mod fig10;
mod fig4;
mod fig5;
mod fig6;
mod fig7;
mod fig8;
mod fig9;
mod graceful;
mod halftime;
mod nopoles;
mod parnoise;
mod rate;
mod robust;
mod sizing;
mod tenfold;
mod twelve;
mod unstable;
mod white;

use crate::claim::Claim;

/// All claims in the order of the page.
pub const CLAIMS: &[Claim] = &[
    fig4::CLAIM,
    fig5::CLAIM,
    fig6::CLAIM,
    fig7::CLAIM,
    fig8::CLAIM,
    fig9::CLAIM,
    fig10::CLAIM,
    db46::CLAIM,
    graceful::CLAIM,
    robust::CLAIM,
    white::CLAIM,
    nopoles::CLAIM,
    rate::CLAIM,
    drift::CLAIM,
    halftime::CLAIM,
    tenfold::CLAIM,
    twelve::CLAIM,
    parnoise::CLAIM,
    converge::CLAIM,
    unstable::CLAIM,
    sizing::CLAIM,
];
