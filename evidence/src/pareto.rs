//! Pareto fronts: the cost and the error of methods, and whether another method is better in both.

/// One method with one setting, measured.
#[derive(Clone, Debug, PartialEq)]
pub struct Measured {
    /// Method and setting.
    pub name: String,
    /// Its cost.
    pub cost: f64,
    /// Its error.
    pub error: f64,
}

/// The Pareto front: the settings that no other of them dominates, cheapest first.
pub fn front(settings: &[Measured]) -> Vec<&Measured> {
    let beaten = |m: &Measured| {
        settings.iter().any(|other| {
            other.cost <= m.cost && other.error <= m.error && (other.cost < m.cost || other.error < m.error)
        })
    };
    let mut front: Vec<&Measured> = settings.iter().filter(|m| !beaten(m)).collect();
    front.sort_by(|a, b| a.cost.total_cmp(&b.cost));
    front
}

/// The peers that refute the claim that none dominates ours, each with the point of our front that it dominates: it
/// costs less and its error is no greater.
pub fn refuting<'a>(ours: &'a [Measured], peers: &'a [Measured]) -> Vec<(&'a Measured, &'a Measured)> {
    let front = front(ours);
    let beats = |peer: &Measured, ours: &Measured| peer.cost < ours.cost && peer.error <= ours.error;
    peers.iter().filter_map(|peer| Some((peer, *front.iter().find(|ours| beats(peer, ours))?))).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn measured(points: &[(f64, f64)]) -> Vec<Measured> {
        points.iter().map(|&(cost, error)| Measured { name: format!("{cost} {error}"), cost, error }).collect()
    }

    #[test]
    fn the_front_consists_of_undominated_settings() {
        let all = measured(&[(3.0, 0.0), (1.0, 0.5), (2.0, 0.5), (4.0, 0.0), (2.0, 0.1)]);
        let names: Vec<&str> = front(&all).iter().map(|m| &m.name[..]).collect();
        assert_eq!(names, ["1 0.5", "2 0.1", "3 0"]);
    }

    #[test]
    fn a_peer_refutes_by_beating_a_point_of_the_front_only() {
        let ours = measured(&[(1.0, 0.5), (3.0, 0.0), (4.0, 0.4)]);
        // Cheaper but less accurate, more accurate but more expensive, below a point that we dominate ourselves.
        assert!(refuting(&ours, &measured(&[(0.5, 0.6), (3.5, 0.0), (3.2, 0.3)])).is_empty());
        let peers = measured(&[(2.0, 0.0), (0.9, 0.5)]);
        let found: Vec<(&str, &str)> =
            refuting(&ours, &peers).iter().map(|(peer, ours)| (&peer.name[..], &ours.name[..])).collect();
        assert_eq!(found, [("2 0", "3 0"), ("0.9 0.5", "1 0.5")]);
    }
}
