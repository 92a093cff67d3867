//! The backend that draws on a device: one compute pass a tile of the image, and more only for rays that are very long.

use super::adapter::{AdapterChoice, Device};
use super::buffers::{TileBuffers, buffer, read, rows_of_tile};
use super::lines::texture_of_words;
use super::pool::Pool;
use super::shader::{SHADER, Sampling, constants};
use crate::backend::{Backend, Drawing, Drawn};
use crate::error::RenderError;
use crate::picture::Picture;
use crate::ray::{Frame, Variant, pack, table_rows};
use crate::view::RayGrid;
use octree_store::loader::{BrickFormat, Upload};
use octree_store::{Geometry, Metadata};
use std::sync::atomic::Ordering;
use wgpu::{BindingType, Buffer, BufferBindingType, BufferUsages, Features, TextureFormat};

/// Entries of the table in a line of its texture, as `transfer.wgsl` reads them.
const TABLE_LINE: usize = 1024;

/// Texels of 256 nodes: a line of theirs, as `node.wgsl` reads them.
const NODE_LINE: usize = 4 * 256;

/// Distances that are none on the device.
const FAR: f32 = 3e38;

/// The shader on a device.
#[derive(Debug)]
pub struct GpuBackend {
    device: Device,
    geometry: Geometry,
    spacing_xyz: [f64; 3],
    sampling: Sampling,
    pool: Pool,
    sampler: wgpu::Sampler,
    module: wgpu::ShaderModule,
    bind_layout: wgpu::BindGroupLayout,
    /// With whether rays go on from their states.
    pipelines: Vec<(Variant, bool, wgpu::ComputePipeline)>,
    frame: Buffer,
    unfinished: Buffer,
    clock: Option<wgpu::QuerySet>,
    ticks: Buffer,
    tile: Option<TileBuffers>,
}

impl GpuBackend {
    /// Opens a device with a pool of so many slots for a store's bricks.
    ///
    /// # Errors
    /// When there is no such adapter, or it cannot do what is needed.
    pub fn new(
        choice: &AdapterChoice,
        sampling: Sampling,
        geometry: &Geometry,
        metadata: &Metadata,
        slots: usize,
    ) -> Result<Self, RenderError> {
        let device = Device::open(choice)?;
        let pool = Pool::new(&device, BrickFormat::of(metadata), geometry.brick_side(), slots)?;
        let filterable = pool.format() != wgpu::TextureFormat::R32Float
            || device.has(Features::FLOAT32_FILTERABLE);
        if sampling == Sampling::Hardware && !filterable {
            let reason = "it cannot interpolate 32-bit textures: use --sampling manual".to_owned();
            return Err(RenderError::Adapter { adapter: device.name, reason });
        }
        let filter = if filterable { wgpu::FilterMode::Linear } else { wgpu::FilterMode::Nearest };
        let sampler = device.handle.create_sampler(&wgpu::SamplerDescriptor {
            mag_filter: filter,
            min_filter: filter,
            ..Default::default()
        });
        let module = device.handle.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("rays"),
            source: wgpu::ShaderSource::Wgsl(SHADER.into()),
        });
        let bind_layout = bind_layout(&device, filterable);
        let clock = device.has(Features::TIMESTAMP_QUERY).then(|| {
            device.handle.create_query_set(&wgpu::QuerySetDescriptor {
                label: Some("clock"),
                ty: wgpu::QueryType::Timestamp,
                count: 2,
            })
        });
        let (storage, to, from) =
            (BufferUsages::STORAGE, BufferUsages::COPY_DST, BufferUsages::COPY_SRC);
        let frame_bytes = size_of::<Frame>() as u64;
        let frame = buffer(&device, "frame", frame_bytes, BufferUsages::UNIFORM | to);
        let unfinished = buffer(&device, "unfinished", 16, storage | to | from);
        let ticks = buffer(&device, "ticks", 16, BufferUsages::QUERY_RESOLVE | from);
        device.check("compiling the shader")?;
        Ok(Self {
            geometry: *geometry,
            spacing_xyz: metadata.spacing_xyz,
            sampling,
            pool,
            sampler,
            module,
            bind_layout,
            pipelines: Vec::new(),
            frame,
            unfinished,
            clock,
            ticks,
            tile: None,
            device,
        })
    }

    fn pipeline(
        &mut self,
        variant: Variant,
        resumed: bool,
    ) -> Result<wgpu::ComputePipeline, RenderError> {
        let mut made = self.pipelines.iter();
        if let Some((.., pipeline)) = made.find(|made| (made.0, made.1) == (variant, resumed)) {
            return Ok(pipeline.clone());
        }
        let layout = self.device.handle.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("rays"),
            bind_group_layouts: &[Some(&self.bind_layout)],
            immediate_size: 0,
        });
        let pipeline =
            self.device.handle.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                label: Some("rays"),
                layout: Some(&layout),
                module: &self.module,
                entry_point: Some("draw"),
                compilation_options: wgpu::PipelineCompilationOptions {
                    constants: &constants(variant, resumed, self.sampling),
                    ..Default::default()
                },
                cache: None,
            });
        self.device.check("compiling the shader")?;
        self.pipelines.push((variant, resumed, pipeline.clone()));
        Ok(pipeline)
    }

    fn bind(
        &self,
        nodes: &wgpu::TextureView,
        table: &wgpu::TextureView,
        seen: &Buffer,
        tile: &TileBuffers,
    ) -> wgpu::BindGroup {
        let view = self.pool.view();
        let resources = [
            self.frame.as_entire_binding(),
            wgpu::BindingResource::TextureView(nodes),
            wgpu::BindingResource::TextureView(&view),
            wgpu::BindingResource::Sampler(&self.sampler),
            wgpu::BindingResource::TextureView(table),
            seen.as_entire_binding(),
            tile.colors.as_entire_binding(),
            tile.depths.as_entire_binding(),
            tile.states.as_entire_binding(),
            self.unfinished.as_entire_binding(),
        ];
        let entries: Vec<_> = (0..)
            .zip(resources)
            .map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource })
            .collect();
        self.device.handle.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("rays"),
            layout: &self.bind_layout,
            entries: &entries,
        })
    }

    /// One dispatch over a tile; what it left is copied to `back`: unfinished, ticks, colours, depths, seen.
    fn dispatch(
        &self,
        pipeline: &wgpu::ComputePipeline,
        group: &wgpu::BindGroup,
        tile: &TileBuffers,
        seen: &Buffer,
        back: &Buffer,
    ) {
        let mut encoder =
            self.device.handle.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.clear_buffer(&self.unfinished, 0, None);
        {
            let timestamp_writes =
                self.clock.as_ref().map(|query_set| wgpu::ComputePassTimestampWrites {
                    query_set,
                    beginning_of_pass_write_index: Some(0),
                    end_of_pass_write_index: Some(1),
                });
            let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                label: Some("rays"),
                timestamp_writes,
            });
            pass.set_pipeline(pipeline);
            pass.set_bind_group(0, group, &[]);
            let rows = rows_of_tile(tile.size);
            pass.dispatch_workgroups(tile.size[0].div_ceil(8), rows.div_ceil(8), 1);
        }
        if let Some(clock) = &self.clock {
            encoder.resolve_query_set(clock, 0..2, &self.ticks, 0);
        }
        encoder.copy_buffer_to_buffer(&self.unfinished, 0, back, 0, 16);
        encoder.copy_buffer_to_buffer(&self.ticks, 0, back, 16, 16);
        encoder.copy_buffer_to_buffer(&tile.colors, 0, back, 32, 16 * tile.pixels);
        let depths = 32 + 16 * tile.pixels;
        encoder.copy_buffer_to_buffer(&tile.depths, 0, back, depths, 4 * tile.pixels);
        let after = depths + 4 * tile.pixels;
        encoder.copy_buffer_to_buffer(seen, 0, back, after, seen.size());
        self.device.queue.submit([encoder.finish()]);
    }
}

impl Backend for GpuBackend {
    fn kind(&self) -> &'static str {
        "gpu"
    }

    fn adapter(&self) -> String {
        self.device.name.clone()
    }

    fn upload(&mut self, uploads: &[Upload]) -> Result<(), RenderError> {
        self.pool.upload(&self.device, uploads)
    }

    fn draw(&mut self, drawing: &Drawing) -> Result<Drawn, RenderError> {
        let Drawing { index, view, look, table, float_range, ends, stop } = *drawing;
        let size = view.size;
        let grid = RayGrid::new(view, look, self.geometry.dims_xyz(), self.spacing_xyz);
        let frame = Frame::new(&grid, look, &self.geometry, self.pool.slots_xyz())?;
        let variant = Variant::of(look);
        let nodes = pack(index, look, float_range);
        let all = (size[0] as usize) * (size[1] as usize);
        let mut picture =
            Picture { size, colors: vec![[0.0; 4]; all], depths: vec![f32::INFINITY; all] };
        if nodes.is_empty() {
            return Ok(Drawn { picture, seen: Vec::new(), device_secs: None });
        }
        let tile = match self.tile.take() {
            Some(tile) if tile.size == size => tile,
            _ => TileBuffers::new(&self.device, size),
        };
        let node_words = bytemuck::cast_slice(&nodes);
        let format = TextureFormat::Rgba32Uint;
        let node_lines = texture_of_words(&self.device, "nodes", format, node_words, NODE_LINE);
        let table = bytemuck::cast_slice(table_rows(table));
        let table = texture_of_words(
            &self.device,
            "table",
            TextureFormat::Rgba32Float,
            table,
            3 * TABLE_LINE,
        );
        let seen_usage = BufferUsages::STORAGE | BufferUsages::COPY_SRC;
        let seen = buffer(&self.device, "seen", 4 * nodes.len() as u64, seen_usage);
        let back_bytes = 32 + 20 * tile.pixels + seen.size();
        let back_usage = BufferUsages::MAP_READ | BufferUsages::COPY_DST;
        let back = buffer(&self.device, "back", back_bytes, back_usage);
        let group = self.bind(&node_lines, &table, &seen, &tile);
        let rows = rows_of_tile(size);
        let mut seen_bytes = Vec::new();
        let mut device_secs = None;
        for first_row in (0..size[1]).step_by(rows as usize) {
            let from = (first_row * size[0]) as usize;
            let pixels = (tile.pixels as usize).min(all - from);
            let mut end = vec![f32::MAX; tile.pixels as usize];
            if let Some(ends) = ends {
                end[..pixels].copy_from_slice(&ends[from..from + pixels]);
            }
            self.device.queue.write_buffer(&tile.depths, 0, bytemuck::cast_slice(&end));
            let mut resumed = false;
            let found = loop {
                if stop.load(Ordering::Relaxed) {
                    return Err(RenderError::Stopped);
                }
                let pipeline = self.pipeline(variant, resumed)?;
                let frame = Frame { first_row, ..frame };
                self.device.queue.write_buffer(&self.frame, 0, bytemuck::bytes_of(&frame));
                self.dispatch(&pipeline, &group, &tile, &seen, &back);
                let found = read(&self.device, &back, back_bytes)?;
                device_secs = add(device_secs, seconds(&found, &self.device));
                if found[..4] == [0; 4] {
                    break found;
                }
                resumed = true;
            };
            let (colors, rest) = found[32..].split_at(16 * tile.pixels as usize);
            let (depths, seen) = rest.split_at(4 * tile.pixels as usize);
            for i in 0..pixels {
                picture.colors[from + i] =
                    bytemuck::pod_read_unaligned(&colors[16 * i..16 * i + 16]);
                let depth: f32 = bytemuck::pod_read_unaligned(&depths[4 * i..4 * i + 4]);
                picture.depths[from + i] = if depth < FAR { depth } else { f32::INFINITY };
            }
            // Flags are little-endian words; they are never cleared between tiles.
            seen_bytes = seen.as_chunks::<4>().0.iter().map(|word| word[0]).collect();
            seen_bytes.truncate(nodes.len());
        }
        self.tile = Some(tile);
        Ok(Drawn { picture, seen: seen_bytes, device_secs })
    }
}

fn add(a: Option<f64>, b: Option<f64>) -> Option<f64> {
    Some(a.unwrap_or(0.0) + b?)
}

/// Seconds between the two ticks; none where the device does not count. (Mesa 22.3 says 0 and 0.)
fn seconds(back: &[u8], device: &Device) -> Option<f64> {
    let tick = |at: usize| back[at..at + 8].first_chunk::<8>().map(|b| u64::from_le_bytes(*b));
    let passed = tick(24)?.checked_sub(tick(16)?)?;
    let period = f64::from(device.queue.get_timestamp_period());
    (device.has(Features::TIMESTAMP_QUERY) && passed > 0).then_some(passed as f64 * period * 1e-9)
}

fn bind_layout(device: &Device, filterable: bool) -> wgpu::BindGroupLayout {
    let storage = BindingType::Buffer {
        ty: BufferBindingType::Storage { read_only: false },
        has_dynamic_offset: false,
        min_binding_size: None,
    };
    let uniform = BindingType::Buffer {
        ty: BufferBindingType::Uniform,
        has_dynamic_offset: false,
        min_binding_size: None,
    };
    let texture = BindingType::Texture {
        sample_type: wgpu::TextureSampleType::Float { filterable },
        view_dimension: wgpu::TextureViewDimension::D3,
        multisampled: false,
    };
    let sampler = BindingType::Sampler(if filterable {
        wgpu::SamplerBindingType::Filtering
    } else {
        wgpu::SamplerBindingType::NonFiltering
    });
    let words = |sample_type| BindingType::Texture {
        sample_type,
        view_dimension: wgpu::TextureViewDimension::D2,
        multisampled: false,
    };
    let types = [
        uniform,
        words(wgpu::TextureSampleType::Uint),
        texture,
        sampler,
        words(wgpu::TextureSampleType::Float { filterable: false }),
        storage,
        storage,
        storage,
        storage,
        storage,
    ];
    let entries: Vec<_> = (0..)
        .zip(types)
        .map(|(binding, ty)| wgpu::BindGroupLayoutEntry {
            binding,
            visibility: wgpu::ShaderStages::COMPUTE,
            ty,
            count: None,
        })
        .collect();
    device.handle.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
        label: Some("rays"),
        entries: &entries,
    })
}
