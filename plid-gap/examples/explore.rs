//! Development: diagnoses CASES into OUT/NAME and predicts LABELS/NAME/test_u.csv.
use plid_gap::effects::Library;
use std::path::Path;
fn main() {
    let args: Vec<String> = std::env::args().skip(1).collect();
    let (out, labels) = (Path::new(&args[0]), Path::new(&args[1]));
    let without: Vec<String> = std::env::var("WITHOUT").unwrap_or_default().split(',').map(String::from).collect();
    for folder in &args[2..] {
        let clock = std::time::Instant::now();
        let folder = Path::new(folder);
        let name = folder.file_name().unwrap().to_str().unwrap().to_string();
        let mut library = Library::standard().without(&without);
        if std::env::var("LOO").is_ok() {
            let label: serde_json::Value = serde_json::from_str(&std::fs::read_to_string(labels.join(&name).join("label.json")).unwrap()).unwrap();
            let names: Vec<String> = label["effects"].as_array().unwrap().iter().map(|e| e["effect"].as_str().unwrap().to_string()).collect();
            library = library.without(&names);
        }
        let case = plid_gap::case::Case::read(&folder.join("case.toml")).unwrap();
        let outcome = plid_gap::diagnose(&case, &library, &mut |_| {}).unwrap();
        let to = out.join(&name);
        std::fs::create_dir_all(&to).unwrap();
        plid_gap::write(&outcome, &case, &to).unwrap();
        let predictor = plid_gap::predict::Predictor::read(&to.join("sim-with-effect.json"), &Library::standard()).unwrap();
        let table = plid_lab::data::read(&labels.join(&name).join("test_u.csv"), None).unwrap();
        let u = plid_gap::case::columns(&plid_lab::data::channels(&table, &predictor.model.inputs, plid_lab::data::MissingPolicy::Error).unwrap());
        let y = predictor.run(&u, predictor.t0);
        let mut text = predictor.model.outputs.join(",") + "\n";
        for k in 0..y[0].len() { text += &(y.iter().map(|y| y[k].to_string()).collect::<Vec<_>>().join(",") + "\n"); }
        std::fs::write(to.join("predicted.csv"), text).unwrap();
        let d = &outcome.diagnosis;
        println!("== {name} {:.1} s: {}", clock.elapsed().as_secs_f64(), d.sentence);
        println!("   costs {:.4?} excess {:.1} left {:.4} bent {:.1} unknown {:.2}", outcome.evidence.costs, outcome.evidence.adequacy.excess, outcome.evidence.adequacy.left, outcome.evidence.adequacy.bent, outcome.evidence.adequacy.unknown);
        println!("   next: {:?}", outcome.evidence.stages.last().map(|s| s.iter().take(3).map(|e| format!("{}@{} {:.0} ({:.2})", e.0, e.1, e.2, e.3)).collect::<Vec<_>>()));
        println!("   first: {:?}", outcome.evidence.stages.first().map(|s| s.iter().take(3).map(|e| format!("{}@{} {:.0} ({:.2})", e.0, e.1, e.2, e.3)).collect::<Vec<_>>()));
        println!("   unseen {:?}", outcome.evidence.unseen);
        println!("   candidates {:?}", d.candidates.iter().take(4).map(|c| format!("{} {:.3}", if c.unknown { "unknown".into() } else { c.effects.iter().map(|e| format!("{}@{}", e.effect, e.location)).collect::<Vec<_>>().join("+") }, c.probability)).collect::<Vec<_>>());
        println!("   gap given {:.3} refit {:.3} free {:.3} with {:.3} floor {:.3} shrink {:.2} {:.2?} placebo {:.2} ceiling {:.2} stated {:.3}; side {:?} slope {:?}", d.gap.as_given, d.gap.refit, d.gap.free_refit, d.gap.with_effect, d.gap.noise_floor, d.gap.shrink, d.gap.shrink_ci95, d.gap.placebo_shrink, d.gap.share_of_ceiling, d.gap.predicted_held_out_gap, d.place.side, d.place.level_slope);
    }
}
