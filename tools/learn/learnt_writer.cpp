#include "tools/learn/learnt_writer.hpp"

#include "tools/base/text.hpp"
#include "tools/gap/report/robot_writer.hpp"
#include "tools/gap/residual/residual_writer.hpp"

namespace tiller::tools::learn {

bool learnt_robot_text(const RobotFile& robot, const std::string& old_text, const Learnt& learnt,
                       const std::string& network_file, std::string& text, std::string& error) {
  const Candidate& c = learnt.candidates[static_cast<std::size_t>(learnt.chosen)];
  gap::Explanation base;
  for (std::size_t p = 0; p < learnt.base.size(); ++p) {
    gap::Estimate e;
    e.name = robot.params[p];
    e.fixed = robot.config.priors[p].kind == tiller_prior_fixed;
    e.mean = learnt.base[p];
    e.sd = learnt.base_sd[p];
    base.params.push_back(e);
  }
  if (!gap::write_robot(robot, old_text, base, "", text, error)) return false;
  text = gap::with_process_sd(text, robot, c.process_sd.data());
  if (!text.empty() && text.back() != '\n') text += '\n';
  text += format(
              "\n# Forces learnt by `tiller learn` from %.0f s of logs: rollouts of one second %.2f times as wrong as "
              "without.\n",
              learnt.seconds, c.held_out.rms_sigma / learnt.before.rms_sigma) +
          "[[effects]]\nkind = \"" + c.name + "\"\n\n[network]\nfile = \"" + network_file + "\"\n";
  return true;
}

std::string learnt_text(const Learnt& learnt) {
  std::string text =
      format("logs: %.0f s, %zu periods; held out: %zu rollouts of one second\n\n%-28s %10s %10s %12s\n",
             learnt.seconds, learnt.samples, learnt.before.rollouts, "", "error", "of before", "90 % hold");
  text += format("%-28s %8.3g s %10s %10.0f %%\n", "model alone", learnt.before.rms_sigma, "1",
                 100.0 * learnt.before.covered);
  if (!learnt.residual_joint.empty())
    text += format("%-28s %8.3g s %10.2f %10.0f %%\n", ("nine weights at " + learnt.residual_joint).c_str(),
                   learnt.residual.rms_sigma, learnt.residual.rms_sigma / learnt.before.rms_sigma,
                   100.0 * learnt.residual.covered);
  for (const Candidate& c : learnt.candidates)
    text += format("%-28s %8.3g s %10.2f %10.0f %%   beyond the data %.1f times as wide\n", c.name.c_str(),
                   c.held_out.rms_sigma, c.held_out.rms_sigma / learnt.before.rms_sigma, 100.0 * c.held_out.covered,
                   c.spread_ratio);
  return text + "\ns: sensor deviations, root mean square over a second\n" + learnt.why + "\n";
}

}  // namespace tiller::tools::learn
