// Rays and projections of COLMAP's ports. Each line of the input has the name of the port, its 8
// parameters, fx, fy, cx, cy and a pixel. The output has the ray's origin and direction, and the
// pixel of the point 1 m along the ray.
#include <iostream>
#include <string>

#include "colmap/sensor/models_refrac.h"

template <typename Port>
void PrintRay(const double* port, const double* camera, const double* pixel) {
  using Lens = colmap::PinholeCameraModel;
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  Eigen::Vector3d direction = Eigen::Vector3d::Zero();
  Port::template CamFromImg<Lens, double>(
      camera, port, pixel[0], pixel[1], &origin, &direction);
  const Eigen::Vector3d point = origin + direction;
  double x = 0;
  double y = 0;
  Port::template ImgFromCam<Lens, double>(
      camera, port, point[0], point[1], point[2], &x, &y);
  for (const double value : {origin[0], origin[1], origin[2], direction[0], direction[1],
                             direction[2], x}) {
    std::cout << value << ' ';
  }
  std::cout << y << '\n';
}

int main() {
  std::cout.precision(17);
  std::string name;
  double port[8], camera[4], pixel[2];
  while (std::cin >> name) {
    for (double& value : port) std::cin >> value;
    for (double& value : camera) std::cin >> value;
    for (double& value : pixel) std::cin >> value;
    if (name == "FLATPORT") {
      PrintRay<colmap::FlatPort>(port, camera, pixel);
    } else {
      PrintRay<colmap::DomePort>(port, camera, pixel);
    }
  }
}
