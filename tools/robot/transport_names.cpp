#include "tools/robot/transport_names.hpp"

namespace tiller::tools {
namespace {

struct Transport {
  const char *name, *alias;
};

constexpr Transport kTransports[] = {
#define TILLER_TRANSPORT(name, alias, help) {#name, alias},
#include "tools/robot/transports.def"
};

}  // namespace

Words transport_names() {
  Words names;
  for (const Transport& transport : kTransports) names.emplace_back(transport.name);
  return names;
}

Words transport_words() {
  Words words;
  for (const Transport& transport : kTransports)
    for (const char* word : {transport.name, transport.alias})
      if (*word) words.emplace_back(word);
  return words;
}

std::string transport_named(const std::string& word) {
  for (const Transport& transport : kTransports)
    if (*transport.alias && word == transport.alias) return transport.name;
  return word;
}

}  // namespace tiller::tools
