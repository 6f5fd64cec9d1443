set(sources
  filter_layout.cpp filter_posterior.cpp lane_filter.cpp particles.cpp filter_start.cpp filter_past.cpp filter_summary.cpp filter_moves.cpp
  outlier_gate.cpp filter_adequacy.cpp response.cpp friction_evidence.cpp filter_estimate.cpp disturbance_report.cpp disturbance_states.cpp
  scale_evidence.cpp sudden_forces.cpp jump_bank.cpp jump_banks.cpp)
