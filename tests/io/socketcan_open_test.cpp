// On any machine: what a user meets who has no CAN yet.
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstdio>
#include <string>

#include "io/socketcan_transport.hpp"

namespace tiller {
namespace {

SocketCanOptions pendulum() {
  SocketCanOptions options;
  options.interface = "can_absent";
  options.layout.motor_count = options.layout.channel_count = 1;
  options.layout.motors[0].node = 1;
  options.layout.motors[0].wheel_radius_m = 1.0;
  return options;
}

TEST(SocketCanOpen, AMissingKernelOrInterfaceComesWithItsRemedy) {
  const int probe = socket(PF_CAN, SOCK_RAW, 1);
  const bool has_can = probe >= 0;
  if (has_can) close(probe);
  SocketCanTransport transport;
  OpenError error;
  EXPECT_EQ(tiller_status_io_error, socketcan_open(&transport, pendulum(), &error));
  std::printf("%s\n", error.text);
  const std::string text = error.text;
  EXPECT_NE(std::string::npos, text.find(has_can ? "ip link add can_absent type vcan" : "modprobe can")) << text;
}

TEST(SocketCanOpen, OnlyABoundCanSocketIsTakenOver) {
  const int wrong = socket(AF_INET, SOCK_DGRAM, 0);
  for (const std::string& name : {"fd:" + std::to_string(wrong), std::string("fd:9999"), std::string("fd:0")}) {
    SocketCanOptions options = pendulum();
    options.interface = name.c_str();
    SocketCanTransport transport;
    OpenError error;
    EXPECT_EQ(tiller_status_io_error, socketcan_open(&transport, options, &error)) << name;
    EXPECT_NE(std::string::npos, std::string(error.text).find("descriptor " + name.substr(3) + " is no CAN socket"));
    EXPECT_EQ(-1, transport.socket) << "who gave it closes it";
  }
  close(wrong);
}

TEST(SocketCanOpen, AWrongLayoutIsRefusedBeforeAnythingIsOpened) {
  SocketCanOptions options = pendulum();
  options.layout.motors[0].wheel_radius_m = 0.0;
  SocketCanTransport transport;
  OpenError error;
  EXPECT_EQ(tiller_status_bad_dimension, socketcan_open(&transport, options, &error));
  EXPECT_NE(std::string::npos, std::string(error.text).find("wheel_radius_m"));
}

TEST(SocketCanOpen, AClosedTransportAnswersClosed) {
  SocketCanTransport transport;
  tiller_measurement_t measurement;
  tiller_command_t command{};
  EXPECT_EQ(tiller_status_transport_closed, kSocketCanTransport.poll(&transport, &measurement));
  EXPECT_EQ(tiller_status_transport_closed, kSocketCanTransport.send(&transport, &command));
  EXPECT_EQ(-1, kSocketCanTransport.descriptor(&transport));
  kSocketCanTransport.close(&transport);
}

}  // namespace
}  // namespace tiller
