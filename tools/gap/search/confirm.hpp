#pragma once

#include "tools/gap/search/search.hpp"

namespace tiller::tools::gap {

/// Asks the windows kept for the proof, once, whether they bear out what the working windows chose. Many effects,
/// starts and spatial periods compete on the working windows, both folds together; the kept ones saw none of the
/// choice, so that a plain test on them owes nothing for it. What is not borne out gives way to its special case (the
/// nominal model is everybody's); what is borne out only weakly shares the answer with it, and so do rivals that the
/// kept windows prefer. Nothing is fitted but start states.
void confirm(Session& session, SearchResult& found);

}  // namespace tiller::tools::gap
