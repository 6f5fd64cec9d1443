#include "tools/links/lcm_channel.hpp"

#include <cstring>

#include "io/lc02.hpp"
#include "tools/robot/robot_file.hpp"

namespace tiller::tools {
namespace {

constexpr int kMostHandled = 64;  // a flood holds up no tick

}  // namespace

bool LcmChannel::open(const RobotFile& robot, const std::string& name, const char* what, std::string& error) {
  const std::string& address = robot.transport.url;
  UdpmUrl url;
  const char* wrong = is_udpm_url(address.c_str()) ? parse_udpm_url(address.c_str(), &url) : "only udpm:// is read";
  if (wrong != nullptr) {
    error = robot.path + ": [transport] url = \"" + address + "\": " + what + ": " + wrong;
    return false;
  }
  name_ = robot.transport.channel_prefix + name;
  OpenError problem;
  if (has_multicast_route(address.c_str(), &problem) && socket_.open(url, name_.c_str(), &problem) == tiller_status_ok)
    return true;
  error = robot.path + ": " + what + " over LCM: " + problem.text;
  return false;
}

void LcmChannel::poll(const std::function<void(const std::uint8_t*, std::uint32_t)>& take,
                      const std::function<void(const char*)>& refuse) {
  UdpDatagram datagram;
  for (int handled = 0; handled < kMostHandled && socket_.read(&datagram) == UdpRead::kDatagram; ++handled) {
    Lc02Packet packet;
    if (datagram.refusal != nullptr)
      refuse(datagram.refusal);
    else if (const char* why = lc02_parse(datagram.bytes, datagram.size, &packet))
      refuse(why);
    else if (name_ == packet.channel)
      take(packet.message, packet.size);
  }
}

void LcmChannel::send(const std::string& channel, const std::uint8_t* bytes, std::uint32_t size) {
  std::uint8_t packet[UdpDatagram::kCapacity];
  const std::uint32_t at = lc02_begin(packet, sizeof packet, sent_++, channel.c_str());
  if (at == 0 || at + size > sizeof packet) return;
  std::memcpy(packet + at, bytes, size);
  (void)socket_.send(packet, at + size);
}

}  // namespace tiller::tools
