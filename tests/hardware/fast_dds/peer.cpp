// An arm and a camera by Fast DDS, the DDS that ROS 2 runs by default: peer DOMAIN, until its standard input ends.
//
// It goes where trajectories say, exactly and at once, and sends joint states (reliable, 250 Hz) and images
// (best effort, 1 MP mono, 30 Hz), stamped with CLOCK_MONOTONIC. For each line of input it prints what it heard.
#include "messagesPubSubTypes.h"

#include <fastdds/dds/domain/DomainParticipant.hpp>
#include <fastdds/dds/domain/DomainParticipantFactory.hpp>
#include <fastdds/dds/publisher/DataWriter.hpp>
#include <fastdds/dds/publisher/Publisher.hpp>
#include <fastdds/dds/subscriber/DataReader.hpp>
#include <fastdds/dds/subscriber/SampleInfo.hpp>
#include <fastdds/dds/subscriber/Subscriber.hpp>
#include <fastdds/rtps/transport/UDPv4TransportDescriptor.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cstdio>
#include <iostream>
#include <string>
#include <thread>

using namespace eprosima::fastdds::dds;
using namespace std::chrono;
using JointState = sensor_msgs::msg::dds_::JointState_;
using Image = sensor_msgs::msg::dds_::Image_;
using Trajectory = trajectory_msgs::msg::dds_::JointTrajectory_;

static double now() { return duration<double>(steady_clock::now().time_since_epoch()).count(); }

static void stamp(builtin_interfaces::msg::dds_::Time_& time) {
  auto ns = duration_cast<nanoseconds>(steady_clock::now().time_since_epoch()).count();
  time.sec(ns / 1000000000);
  time.nanosec(ns % 1000000000);
}

// Where a joint is on a trajectory so long after its beginning, by the cubics between its points.
static void follow(Trajectory& way, const std::string& name, double since, double& q, double& v) {
  auto& points = way.points();
  auto& names = way.joint_names();
  size_t j = std::find(names.begin(), names.end(), name) - names.begin();
  auto at = [&](size_t k) {
    return points[k].time_from_start().sec() + 1e-9 * points[k].time_from_start().nanosec();
  };
  size_t last = points.size() - 1;
  if (since >= at(last)) { q = points[last].positions()[j]; v = 0.0; return; }
  size_t k = 0;
  while (k + 1 < last && since >= at(k + 1)) ++k;
  double h = at(k + 1) - at(k), s = (since - at(k)) / h;
  double p0 = points[k].positions()[j], p1 = points[k + 1].positions()[j];
  double v0 = points[k].velocities()[j], v1 = points[k + 1].velocities()[j], d = p1 - p0;
  q = p0 + s * (h * v0 + s * (3 * d - h * (2 * v0 + v1) + s * (h * (v0 + v1) - 2 * d)));
  v = v0 + s * (2 * (3 * d / h - 2 * v0 - v1) + 3 * s * (v0 + v1 - 2 * d / h));
}

int main(int, char** argv) {
  DomainParticipantQos qos;
  qos.transport().use_builtin_transports = false;
  auto udp = std::make_shared<eprosima::fastdds::rtps::UDPv4TransportDescriptor>();
  udp->interfaceWhiteList.push_back("127.0.0.1");
  udp->sendBufferSize = udp->receiveBufferSize = 4 << 20;
  qos.transport().user_transports.push_back(udp);
  eprosima::fastrtps::rtps::Locator_t here;
  eprosima::fastrtps::rtps::IPLocator::setIPv4(here, 127, 0, 0, 1);
  here.port = 0;
  qos.wire_protocol().builtin.initialPeersList.push_back(here);
  auto* node = DomainParticipantFactory::get_instance()->create_participant(std::stoi(argv[1]), qos);
  TypeSupport states(new sensor_msgs::msg::dds_::JointState_PubSubType());
  TypeSupport images(new sensor_msgs::msg::dds_::Image_PubSubType());
  TypeSupport ways(new trajectory_msgs::msg::dds_::JointTrajectory_PubSubType());
  states.register_type(node);
  images.register_type(node);
  ways.register_type(node);
  auto* out = node->create_publisher(PUBLISHER_QOS_DEFAULT);
  auto* in = node->create_subscriber(SUBSCRIBER_QOS_DEFAULT);
  auto topic = [&](const char* name, TypeSupport& type) {
    return node->create_topic(name, type.get_type_name(), TOPIC_QOS_DEFAULT);
  };
  DataWriterQos reliable = DATAWRITER_QOS_DEFAULT, best = DATAWRITER_QOS_DEFAULT;
  reliable.reliability().kind = RELIABLE_RELIABILITY_QOS;
  reliable.history().depth = 10;
  best.reliability().kind = BEST_EFFORT_RELIABILITY_QOS;
  best.history().depth = 5;
  best.publish_mode().kind = ASYNCHRONOUS_PUBLISH_MODE;
  DataReaderQos wanted = DATAREADER_QOS_DEFAULT;
  wanted.reliability().kind = RELIABLE_RELIABILITY_QOS;
  wanted.history().depth = 10;
  auto* sent_states = out->create_datawriter(topic("rt/joint_states", states), reliable);
  auto* sent_images = out->create_datawriter(topic("rt/camera/image_raw", images), best);
  auto* heard = in->create_datareader(
      topic("rt/joint_trajectory_controller/joint_trajectory", ways), wanted);

  JointState state;
  for (const char* name : {"base", "shoulder", "elbow", "wrist_1", "wrist_2", "wrist_3"}) state.name().push_back(name);
  state.position().assign(6, 0.5);
  state.velocity().assign(6, 0.0);
  Image image;
  image.header().frame_id("camera");
  image.height(1024), image.width(1024), image.step(1024), image.encoding("mono8");
  image.data().resize(1 << 20);
  Trajectory way, newer;
  SampleInfo info;
  std::atomic<long> commands{0}, pictures{0};
  std::atomic<bool> ended{false};
  std::atomic<double> first{0.5};
  std::thread arm([&] {
    auto begin = steady_clock::now();
    for (long k = 0; !ended; ++k) {
      while (heard->take_next_sample(&newer, &info) == ReturnCode_t::RETCODE_OK)
        if (info.valid_data && !newer.points().empty() &&
            std::is_permutation(state.name().begin(), state.name().end(), newer.joint_names().begin(),
                                newer.joint_names().end()))
          ++commands, way = newer;
      if (!way.points().empty()) {
        double since = now() - way.header().stamp().sec() - 1e-9 * way.header().stamp().nanosec();
        for (size_t j = 0; j < 6; ++j) follow(way, state.name()[j], since, state.position()[j], state.velocity()[j]);
      }
      first = state.position()[0];
      stamp(state.header().stamp());
      sent_states->write(&state);
      if (k % 8 == 0) {
        image.data().assign(1 << 20, pictures % 256);
        stamp(image.header().stamp());
        sent_images->write(&image);
        ++pictures;
      }
      std::this_thread::sleep_until(begin + (k + 1) * milliseconds(4));
    }
  });
  std::string line;
  std::puts("served");
  std::fflush(stdout);
  while (std::getline(std::cin, line)) {
    std::printf("%ld %ld %.6f\n", commands.load(), pictures.load(), first.load());
    std::fflush(stdout);
  }
  ended = true;
  arm.join();
}
