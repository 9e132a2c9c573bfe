use plid_gap::effects::Library;
use plid_gap::problem::{Effort, Placed, sum_of_squares};
use plid_gap::screen::{Base, screen};
use plid_gap::simulate::Fineness;
use rayon::prelude::*;
use std::time::Instant;

fn main() {
    for path in std::env::args().skip(1) {
        let clock = Instant::now();
        let case = plid_gap::case::Case::read(std::path::Path::new(&path)).unwrap();
        let ready = plid_gap::prepare::prepare(case.model.as_ref().unwrap(), &case.records, &case.config.nuisance).unwrap();
        let p = &ready.problem;
        println!("{path}: {:.2} s; chain {:?}; rows {}; noise sensors {:?} rms {:?}", clock.elapsed().as_secs_f64(), p.plant.chain.actuator.iter().flatten().map(|x| x.pole / 6.283).collect::<Vec<_>>(), p.rows(),
            ready.noise.sensors().iter().map(|v| (v.sqrt() * 1e5).round() / 1e5).collect::<Vec<_>>(), ready.noise.rms());
        println!("  tones {:?} filters {:?}", p.setting.tones, p.plant.chain.filter.iter().map(Vec::len).collect::<Vec<_>>());
        let given = p.residual(&p.plant, &vec![0.0; p.nuisance.len()], &[], Fineness::FINE);
        let refit = plid_gap::refit::refit(p);
        println!("  {:.2} s; cost per row: given {:.4} refit {:.4} (penalty {:.1})", clock.elapsed().as_secs_f64(), sum_of_squares(&given) / p.rows() as f64, refit.cost / p.rows() as f64, p.penalty(&refit.eta));
        let library = Library::standard();
        let base = Base { problem: p, tangent: &refit.tangent, plant: &refit.plant, eta: &refit.eta, effects: &[], residual: &refit.residual };
        let entries = screen(&base, &library, |_| false);
        println!("  {:.2} s; {} entries", clock.elapsed().as_secs_f64(), entries.len());
        let effort = Effort { steps: 10, gain: 1.0, fineness: Fineness::COARSE };
        let mut fits: Vec<_> = entries[..10.min(entries.len())].par_iter().map(|entry| {
            let clock = Instant::now();
            let fit = p.fit(&refit.tangent, &refit.eta, &[entry.placed.clone()], effort);
            (entry, fit, clock.elapsed().as_secs_f64())
        }).collect();
        fits.sort_by(|a, b| a.1.cost.total_cmp(&b.1.cost));
        for (entry, fit, time) in &fits {
            let name = |placed: &Placed| format!("{}@{} {:.4?}", placed.effect.name(), placed.place.location(&p.setting.names), placed.parameters);
            println!("    screen {:9.1} absorbed {:.2} | fit gain {:9.1} per row {:.4} {} ({time:.2} s) {}", entry.gain, entry.absorbed, refit.cost - fit.cost, fit.cost / p.rows() as f64, fit.converged, name(&fit.effects[0]));
        }
        println!("  {:.2} s", clock.elapsed().as_secs_f64());
    }
}
