use oblate_chart::measure::*; use oblate_chart::scenes::*; use std::time::*;
struct W(Instant, std::sync::Mutex<(String, Instant)>);
impl Watch for W { fn now(&self)->Duration{self.0.elapsed()} fn at(&self, w:&str,_s:f64){ let mut g=self.1.lock().unwrap(); if g.0!=w { eprintln!("   [{} took {:.1}s]", g.0, g.1.elapsed().as_secs_f64()); *g=(w.into(),Instant::now()); } } }
fn main(){ let scale= if std::env::args().nth(1).as_deref()==Some("full"){Scale::Full}else{Scale::Quick};
 let only=std::env::args().nth(2);
 let w=W(Instant::now(),std::sync::Mutex::new((String::new(),Instant::now())));
 for b in BUILT_IN { if only.as_deref().is_some_and(|o|o!=b.name){continue;} let t=Instant::now(); let s=(b.make)(scale).unwrap(); eprintln!("{} made in {:.1}s", b.name,t.elapsed().as_secs_f64());
  let m=measure(&s,&Plan::new(scale),&w).unwrap(); println!("{} {} splats", m.name, m.splats);
  for r in &m.rows { let e=|o:&Option<Errors>| o.map_or("-".into(),|e|format!("{:6.1} dB p999 {:.5} max {:.4}",e.psnr_db.unwrap_or(999.),e.p999,e.max)); println!("  {:<24} {:8.1} ms [{:.1} {:.1}] {:?} | {} {}| {} {}", r.method,r.median_ms,r.spread_ms[0],r.spread_ms[1],r.visible.unwrap_or_default(), e(&r.errors[0]), if r.is_best[0]{"*"}else{" "}, e(&r.errors[1]), if r.is_best[1]{"*"}else{""}); }
 }
 eprintln!("total {:.1}", w.0.elapsed().as_secs_f64()); }
