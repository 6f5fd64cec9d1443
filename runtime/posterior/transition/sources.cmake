set(sources
  transition_posterior.cpp transition_cloud.cpp transition_sums.cpp transition_moves.cpp innovation.cpp temper.cpp
  robust_weight.cpp retire.cpp
  evidence.cpp residual_summary.cpp discrepancy.cpp transition_lanes.cpp
  bank.cpp bank_delay.cpp bank_evidence.cpp bank_report.cpp)
set(isa_sources transition_lanes_isa.cpp)
