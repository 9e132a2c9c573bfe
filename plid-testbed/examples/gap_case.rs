//! Draws one gap case: `gap_case SEED CASE_FOLDER LABEL_FOLDER [KIND GAP]...`

use std::path::Path;

use plid_testbed::gap::{EffectSpec, GapSpec, draw};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [seed, case, label, effects @ ..] = arguments.as_slice() else {
        return Err("SEED CASE_FOLDER LABEL_FOLDER [KIND GAP]...".into());
    };
    let seed: u64 = seed.parse()?;
    let effects = effects
        .chunks(2)
        .map(|pair| {
            let [kind, gap] = pair else { return Err(format!("{}: no gap", pair[0])) };
            let gap = gap.parse().map_err(|e| format!("{gap}: {e}"))?;
            Ok(EffectSpec { kind: kind.clone(), at: None, law: None, gap })
        })
        .collect::<Result<Vec<_>, String>>()?;
    let drawn = draw(seed, &GapSpec { effects, perturbed: true, ports: true })?;
    drawn.write(Path::new(case), Path::new(label))?;
    println!("gap {:.4}, floor {:.4}", drawn.label.gap_sim, drawn.label.gap_floor);
    Ok(())
}
