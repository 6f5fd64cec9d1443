// Run by in_network_namespace.sh --no-route: a loopback without a multicast route, and no other interface.
#include <gtest/gtest.h>

#include <cstdio>
#include <string>

#include "io/lcm_transport.hpp"

TEST(LcmOpen, WithoutAMulticastRouteTheRemedyIsTold) {
  tiller::LcmTransport transport;
  tiller::LcmOptions options;
  options.measurement_count = options.input_count = 1;
  tiller::OpenError error;
  EXPECT_EQ(tiller_status_io_error, tiller::lcm_transport_open(&transport, options, &error));
  std::printf("%s\n", error.text);
  EXPECT_NE(std::string::npos, std::string(error.text).find("ip route add 224.0.0.0/4 dev lo"));
  EXPECT_EQ(tiller_status_transport_closed, tiller::kLcmTransport.poll(&transport, nullptr));
}

TEST(LcmOpen, ARouteIsMissedBeforeLiblcmIsAsked) {
  tiller::OpenError error;
  EXPECT_FALSE(tiller::has_multicast_route("udpm://239.255.76.67:7667?ttl=0", &error));
  EXPECT_NE(std::string::npos, std::string(error.text).find("ip route add 224.0.0.0/4 dev lo")) << error.text;
  EXPECT_FALSE(tiller::has_multicast_route("udpm://", nullptr));
  EXPECT_TRUE(tiller::has_multicast_route("tcpq://localhost:7700", nullptr)) << "that needs none";
}
