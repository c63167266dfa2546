//! The fifteen cases: ours pass, what is known to fail does, and every number is printed.

use oblate_chart::stability::{Bound, CASES};

/// Runs a case and prints its table.
fn check(number: u8) {
    let case = CASES.iter().find(|case| case.number == number).expect("cases have these numbers");
    let findings = (case.run)();
    println!("{}. {}: {}", case.number, case.title, case.criterion);
    for verdict in &findings.verdicts {
        let (sign, bound) = match verdict.bound {
            Bound::AtMost(bound) => ("at most", bound),
            Bound::AtLeast(bound) => ("at least", bound),
        };
        let says = if verdict.passes() { "passes" } else { "FAILS" };
        println!(
            "  {:<28} {:<48} {:>11.4e} ({sign} {bound:.4e}) {says}",
            verdict.method, verdict.figure, verdict.found
        );
    }
    assert!(!findings.verdicts.is_empty() && !findings.panels.is_empty());
    for panel in &findings.panels {
        assert!(!panel.curves.is_empty(), "{}", panel.title);
        for curve in &panel.curves {
            let is_drawable = curve.points.iter().all(|p| p.iter().all(|x| x.is_finite()));
            assert!(is_drawable && !curve.points.is_empty(), "{}: {}", panel.title, curve.name);
        }
    }
    for verdict in &findings.verdicts {
        assert!(verdict.is_as_known(), "{} {}: {verdict:?}", case.number, case.title);
    }
}

#[test]
fn wide_angle() {
    check(1);
}

#[test]
fn outside() {
    check(2);
}

#[test]
fn dolly() {
    check(3);
}

#[test]
fn turning() {
    check(4);
}

#[test]
fn overlap() {
    check(5);
}

#[test]
fn zoom() {
    check(6);
}

#[test]
fn thin_fog() {
    check(7);
}

#[test]
fn constant_field() {
    check(8);
}

#[test]
fn precision() {
    check(9);
}

#[test]
fn hostile() {
    check(10);
}

#[test]
fn mixed_order() {
    check(11);
}

#[test]
fn visibility() {
    check(12);
}

#[test]
fn determinism() {
    check(13);
}

#[test]
fn levels() {
    check(14);
}

#[test]
fn colors() {
    check(15);
}
