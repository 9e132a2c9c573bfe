//! Draws one gap case: `gap_case SEED CASE_FOLDER LABEL_FOLDER [KIND[:LAW] GAP]...`
//!
//! Every other seed gives a simulation that is slightly off, and two of three give one that says where its ports are.

use std::path::Path;

use plid_testbed::gap::{EffectSpec, GapSpec, draw};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [seed, case, label, effects @ ..] = arguments.as_slice() else {
        return Err("SEED CASE_FOLDER LABEL_FOLDER [KIND[:LAW] GAP]...".into());
    };
    let seed: u64 = seed.parse()?;
    let effects = effects
        .chunks(2)
        .map(|pair| {
            let [kind, gap] = pair else { return Err(format!("{}: no gap", pair[0])) };
            let gap = gap.parse().map_err(|e| format!("{gap}: {e}"))?;
            let (kind, law) = kind.split_once(':').map_or((kind.as_str(), None), |(kind, law)| (kind, Some(law)));
            Ok(EffectSpec { kind: kind.to_owned(), at: None, law: law.map(str::to_owned), gap })
        })
        .collect::<Result<Vec<_>, String>>()?;
    let drawn = draw(
        seed,
        &GapSpec { effects, perturbed: seed % 2 == 1, ports: !seed.is_multiple_of(3), ..GapSpec::default() },
    )?;
    drawn.write(Path::new(case), Path::new(label))?;
    println!("gap {:.4}, floor {:.4}", drawn.label.gap_sim, drawn.label.gap_floor);
    Ok(())
}
