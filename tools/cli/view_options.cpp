#include "tools/cli/view_options.hpp"

namespace tiller::tools {

void add_view_options(CLI::App& command, ViewerOptions& options) {
  command
      .add_option(
          "--view", options.kind,
          "rerun or foxglove: robot, plan, predicted bands, posterior and forces as they change, in a process of "
          "its own (docs/guide/live_view.md)")
      ->check(CLI::IsMember(viewer_kinds()));
  command.add_option("--view-file", options.file,
                     "in the place of a window: what it would show, into a file (.rrd for rerun, .mcap for foxglove)");
  command.add_option("--view-layout", options.layout,
                     "write how the views are arranged: a blueprint (.rbl) for rerun, a layout (.json) for foxglove");
}

std::string contradicted_view(const ViewerOptions& options) {
  if (options.kind.empty() && (!options.file.empty() || !options.layout.empty()))
    return "--view-file and --view-layout: say whose with --view rerun or --view foxglove";
  return "";
}

}  // namespace tiller::tools
