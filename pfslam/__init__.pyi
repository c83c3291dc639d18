"""Where each public name lives: for type checkers, and for ``__init__.py``, which imports a name when it is used."""

from pfslam.beyond.localization import LocalizationConfig as LocalizationConfig
from pfslam.beyond.localization import LocalizationResult as LocalizationResult
from pfslam.beyond.localization import locate as locate
from pfslam.correlation import map_correlation as map_correlation
from pfslam.errors import DataError as DataError
from pfslam.evaluation.trajectory import trajectory_error as trajectory_error
from pfslam.grid import GridSpec as GridSpec
from pfslam.grid import OccupancyGrid as OccupancyGrid
from pfslam.io.course import load_course as load_course
from pfslam.io.course import save_course as save_course
from pfslam.io.datasets import load as load
from pfslam.io.formats import read_known_map as read_known_map
from pfslam.io.formats import read_tum as read_tum
from pfslam.io.formats import write_map as write_map
from pfslam.io.formats import write_texture as write_texture
from pfslam.io.formats import write_tum as write_tum
from pfslam.io.recordings import save as save
from pfslam.motion import dead_reckoning as dead_reckoning
from pfslam.poses import Trajectory as Trajectory
from pfslam.recording import Recording as Recording
from pfslam.refined.floor import map_texture as map_texture
from pfslam.refined.mapper import Mapper as Mapper
from pfslam.refined.odometer import Odometer as Odometer
from pfslam.refined.scan_odometry import with_scan_odometry as with_scan_odometry
from pfslam.run import SlamResult as SlamResult
from pfslam.run import run_slam as run_slam
from pfslam.sensors import RobotModel as RobotModel
from pfslam.simulator import simulate as simulate
from pfslam.slam import Belief as Belief
from pfslam.slam import SlamConfig as SlamConfig
from pfslam.slam import slam_step as slam_step
from pfslam.texture import FloorTexture as FloorTexture
from pfslam.texture import TextureConfig as TextureConfig

__version__: str
