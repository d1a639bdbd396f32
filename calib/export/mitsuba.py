"""Write a sensor of Mitsuba 3: a ray image, and the program that shoots its rays."""

from calib.export import ray_image
from calib.export.beside import file_beside
from calib.export.export import ExportedFiles, ExportRequest

SENSOR = "refracal_mitsuba.py"


def export(request: ExportRequest) -> ExportedFiles:
    image = ray_image.export(request)
    sensor = request.files.write(SENSOR, file_beside("mitsuba_sensor.txt"))
    return ExportedFiles((*image.paths, sensor))
