//! What measurements of `mbkd` share: exact arithmetic, peers, timing. Never published.
