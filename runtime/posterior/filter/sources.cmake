set(sources
  filter_layout.cpp filter_posterior.cpp filter_step.cpp filter_start.cpp filter_summary.cpp disturbance_states.cpp scale_evidence.cpp
  innovation.cpp response.cpp reweight.cpp moves.cpp window.cpp relearn.cpp report.cpp disturbance_report.cpp friction_evidence.cpp
  touch.cpp jump_bank.cpp jumps.cpp)
