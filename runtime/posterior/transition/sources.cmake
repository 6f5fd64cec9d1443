set(sources
  transition_posterior.cpp transition_cloud.cpp temper.cpp transition_particles.cpp transition_ring.cpp residual_sums.cpp
  discrepancy.cpp robust_weight.cpp transition_moves.cpp transition_past.cpp evidence.cpp residual_summary.cpp transition_lanes.cpp
  bank.cpp bank_delay.cpp bank_evidence.cpp bank_report.cpp)
set(isa_sources transition_lanes_isa.cpp)
